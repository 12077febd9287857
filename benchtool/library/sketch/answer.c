#include "settings.h"

#include "answer.h"

#include <math.h>
#include <stdlib.h>

#include "text.h"

#define LARGEST 1e6 /* limits the length of texts */

char answer[LONGEST_ANSWER];
static const char *number; /* of the current command, as received */
static uint32_t now_us;    /* its time, part of the answer */

void answer_to(const char *number_of_command, uint32_t time_us)
{
    number = number_of_command;
    now_us = time_us;
}

uint32_t answer_time_us(void)
{
    return now_us;
}

void answer_begin(char letter)
{
    answer[0] = letter;
    answer[1] = ',';
    strcpy(answer + 2, number);
    add_words(answer, ",");
    add_count(answer, now_us);
}

bool refuse_P(PGM_P reason)
{
    answer_begin('N');
    add_words(answer, ",");
    strcat_P(answer, reason);
    return false;
}

bool numbers(char **fields, uint8_t count, float *values, uint8_t wanted)
{
    if (count != wanted) {
        answer_begin('N');
        add_words(answer, ",");
        add_number(answer, wanted, 0);
        add_words(answer, " fields needed; ");
        add_number(answer, count, 0);
        add_words(answer, " given");
        return false;
    }
    for (uint8_t index = 0; index < count; index++) {
        char *end;
        values[index] = (float)strtod(fields[index], &end);
        if (end == fields[index] || *end || !(fabs(values[index]) <= LARGEST))
            return refuse("a field is no number from -1e6 to 1e6");
    }
    return true;
}
