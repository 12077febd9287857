#include "settings.h"

#include "late.h"

#include <ctype.h>
#include <stdlib.h>
#include <string.h>

#include "answer.h"
#include "text.h"

#define OLDEST_US 500000UL /* the host waits 5 x 100 ms for an answer, then commands a stop */

static uint32_t last_number;
static bool stopped_lately; /* a command can be older than the stop */
static uint32_t stopped_us;

uint32_t late_last_number(void)
{
    return last_number;
}

void late_take(uint32_t number)
{
    last_number = number;
}

void late_note_stop(uint32_t now_us)
{
    stopped_lately = true;
    stopped_us = now_us;
}

void late_forget(uint32_t now_us)
{
    stopped_lately &= now_us - stopped_us <= OLDEST_US;
}

bool whole_number(const char *text, uint32_t *value)
{
    char *end;
    *value = strtoul(text, &end, 10);
    return isdigit(text[0]) && !*end && strlen(text) <= 10 &&
           (strlen(text) < 10 || strcmp(text, "4294967295") <= 0);
}

bool late(uint32_t number, const char *time, uint32_t now_us)
{
    uint32_t then_us;
    if (number <= last_number) {
        refuse("late: number ");
        add_count(answer, number);
        add_words(answer, " comes after ");
        add_count(answer, last_number);
    } else if (!whole_number(time, &then_us)) {
        refuse("no device time; repeat that of the last sample or answer");
    } else if (now_us - then_us > OLDEST_US) {
        refuse("late: ");
        add_count(answer, (now_us - then_us) / 1000);
        add_words(answer, " ms old; limit 500 ms");
    } else if (stopped_lately && now_us - then_us > now_us - stopped_us) {
        refuse("late: given before the last stop");
    } else {
        return false;
    }
    return true;
}
