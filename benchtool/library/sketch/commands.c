#include "settings.h"

#include "commands.h"

#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "clock.h"
#include "guard.h"
#include "hello.h"
#include "line.h"
#include "load_cell.h"
#include "motors.h"
#include "stream.h"
#include "text.h"

#define MOST_FIELDS 3
#define LARGEST 1e6 /* keeps every text shorter than its room */
#define LEAST_RATE_HZ 0.1f

static char answer[130];      /* to the last number, for when it comes again */
static const char *number;    /* of the command in hand, as it came */
static uint16_t last_number;  /* 0 before the first */

static void begin(char letter)
{
    answer[0] = letter;
    answer[1] = ',';
    strcpy(answer + 2, number);
    add_words(answer, ",");
}

static bool refuse_P(PGM_P reason)
{
    begin('N');
    strcat_P(answer, reason);
    return false;
}
#define refuse(reason) refuse_P(PSTR(reason))

/* Read fields as finite numbers; refuses another count of them. */
static bool numbers(char **fields, uint8_t count, float *values, uint8_t wanted)
{
    if (count != wanted) {
        begin('N');
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

static bool hello(char **fields, uint8_t count)
{
    float version;
    if (!numbers(fields, count, &version, 1))
        return false;
    stream_rate(0.0f);
    add_words(answer, ",");
    add_count(answer, hello_send());
    return true;
}

static bool pwm(char **fields, uint8_t count)
{
    float pulses_us[MOTORS];
    bool above_stop = false;
    if (!numbers(fields, count, pulses_us, MOTORS))
        return false;
    for (uint8_t motor = 0; motor < MOTORS; motor++) {
        if (pulses_us[motor] < PWM_STOP_US || pulses_us[motor] > limit_pwm_us()) {
            refuse("pulses must lie from ");
            add_number(answer, PWM_STOP_US, 1);
            add_words(answer, " to ");
            add_number(answer, limit_pwm_us(), 1);
            add_words(answer, " us");
            return false;
        }
        above_stop |= pulses_us[motor] > PWM_STOP_US;
    }
    if (!above_stop) {
        motors_zero();
    } else if (!guard_set_motors(pulses_us)) {
        refuse("stopped by ");
        char *reason = answer + strlen(answer);
        strcpy(reason, guard_reason());
        char *comma = strchr(reason, ',');
        *comma = ':';
        memmove(comma + 2, comma + 1, strlen(comma));
        comma[1] = ' ';
        add_words(answer, "; send clear first");
        return false;
    }
    return true;
}

static bool plate(char **fields, uint8_t count)
{
    (void)fields, (void)count;
    return refuse("this device does not move the plate");
}

static bool where(char **fields, uint8_t count)
{
    if (!numbers(fields, count, NULL, 0))
        return false;
    add_words(answer, ",0,,,");
    return true;
}

static bool tare(char **fields, uint8_t count)
{
    if (!numbers(fields, count, NULL, 0))
        return false;
    return cell_tare() || refuse("the load cell has given no value; check its wiring");
}

static bool rate(char **fields, uint8_t count)
{
    float rate_Hz;
    if (!numbers(fields, count, &rate_Hz, 1))
        return false;
    if (rate_Hz != 0.0f && !(rate_Hz >= LEAST_RATE_HZ && rate_Hz <= MOST_RATE_HZ)) {
        refuse("rate must be 0 or lie from ");
        add_number(answer, LEAST_RATE_HZ, 1);
        add_words(answer, " to ");
        add_number(answer, MOST_RATE_HZ, 0);
        add_words(answer, " Hz");
        return false;
    }
    stream_rate(rate_Hz);
    return true;
}

static bool limit(char **fields, uint8_t count)
{
    float value;
    uint8_t index = 0;
    if (count != 2)
        return refuse("limit takes a name and a number");
    if (!numbers(fields + 1, 1, &value, 1))
        return false;
    while (index < LIMITS && strcmp_P(fields[0], limit_name(index)))
        index++;
    if (index == LIMITS) {
        refuse("no such limit; known:");
        for (index = 0; index < LIMITS; index++) {
            add_words(answer, " ");
            strcat_P(answer, limit_name(index));
        }
        return false;
    }
    if (!limit_narrow(index, value)) {
        refuse("wider than ");
        add_number(answer, limit_value(index), 3);
        add_words(answer, "; only narrower ones");
        return false;
    }
    return true;
}

/* Whatever comes with them, these two are done. */
static bool stop(char **fields, uint8_t count)
{
    (void)fields, (void)count;
    motors_zero();
    return true;
}

static bool clear(char **fields, uint8_t count)
{
    guard_clear();
    return stop(fields, count);
}

static const struct {
    char name[6];
    bool (*run)(char **fields, uint8_t count);
} commands[] = {
    {"hello", hello}, {"pwm", pwm},     {"plate", plate}, {"where", where}, {"tare", tare},
    {"rate", rate},   {"limit", limit}, {"stop", stop},   {"clear", clear},
};
#define COMMANDS (sizeof commands / sizeof *commands)

/* Cut a text at its commas, in place; returns how many fields it has, also when fewer fit. */
static uint8_t split(char *text, char **fields, uint8_t most)
{
    uint8_t count = 0;
    while (text) {
        char *comma = strchr(text, ',');
        if (comma)
            *comma++ = '\0';
        if (count < most)
            fields[count] = text;
        count++;
        text = comma;
    }
    return count;
}

static void carry_out(const char *name, char **fields, uint8_t count)
{
    uint8_t index = 0;
    while (index < COMMANDS && strcmp(name, commands[index].name))
        index++;
    begin('A');
    add_count(answer, clock_us());
    if (index == COMMANDS)
        refuse("unknown command; known: hello pwm plate where tare rate limit stop clear");
    else if (count > MOST_FIELDS)
        refuse("too many fields");
    else
        commands[index].run(fields, count);
}

void commands_take(char *payload)
{
    char *fields[3 + MOST_FIELDS], *end;
    uint8_t count = split(payload, fields, 3 + MOST_FIELDS);
    guard_hear();
    if (count < 3 || fields[0][0] != 'C' || fields[0][1])
        return;
    uint32_t counted = strtoul(fields[1], &end, 10);
    if (*end || strlen(fields[1]) > 5 || counted == 0 || counted > UINT16_MAX)
        return;
    /* A hello is always carried out. */
    if (counted != last_number || !strcmp_P(fields[2], PSTR("hello"))) {
        number = fields[1];
        carry_out(fields[2], fields + 3, count - 3);
        last_number = (uint16_t)counted;
    }
    line_send(answer);
}
