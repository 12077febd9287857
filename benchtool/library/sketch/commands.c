#include "settings.h"

#include "commands.h"

#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#include "answer.h"
#include "clock.h"
#include "guard.h"
#include "hello.h"
#include "late.h"
#include "line.h"
#include "load_cell.h"
#include "motors.h"
#include "stream.h"
#include "text.h"

#define MOST_FIELDS 3
#define LEAST_RATE_HZ 0.1f

static char last_answer[LONGEST_ANSWER]; /* to the last timely command, for a retry */
static uint32_t number;                  /* of the current command */
static bool armed;                       /* pulses above stop are accepted */

/* Treat commands from before a stop as late, and require arming again. */
static bool stop(char **fields, uint8_t count)
{
    (void)fields, (void)count;
    motors_zero();
    armed = false;
    late_note_stop(answer_time_us());
    return true;
}

static bool hello(char **fields, uint8_t count)
{
    float version;
    if (!numbers(fields, count, &version, 1))
        return false;
    if (version < 2.0f)
        return refuse("this device speaks protocol version 2; update benchtool");
    stop(fields, count);
    stream_rate(0.0f);
    late_take(number);
    last_answer[0] = '\0';
    hello_send(answer);
    return true;
}

static bool refuse_latched(void)
{
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

static bool arm(char **fields, uint8_t count)
{
    if (!numbers(fields, count, NULL, 0))
        return false;
    if (guard_latched())
        return refuse_latched();
    armed = true;
    add_words(answer, ",");
    add_hex(answer, stream_hash());
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
        return true;
    }
    if (!armed)
        return refuse("not armed since the last stop; send arm first");
    return guard_set_motors(pulses_us) || refuse_latched();
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
    {"rate", rate},   {"limit", limit}, {"stop", stop},   {"clear", clear}, {"arm", arm},
};
#define COMMANDS (sizeof commands / sizeof *commands)

/* Split a text at its commas, in place; returns the number of fields, even if fewer fit. */
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
    answer_begin('A');
    if (index == COMMANDS)
        refuse("unknown command; known: hello pwm plate where tare rate limit stop clear arm");
    else if (count > MOST_FIELDS)
        refuse("too many fields");
    else
        commands[index].run(fields, count);
}

void commands_take(char *payload)
{
    /* Number, name, time; a hello has its version in place of the time. */
    char *fields[4 + MOST_FIELDS];
    uint8_t count = split(payload, fields, 4 + MOST_FIELDS);
    guard_hear();
    /* With regular heartbeats the counter has not wrapped since the stop. */
    uint32_t now_us = clock_us();
    late_forget(now_us);
    if (count < 3 || fields[0][0] != 'C' || fields[0][1] || !whole_number(fields[1], &number))
        return;
    answer_to(fields[1], now_us);
    const char *name = fields[2];
    bool greeting = !strcmp_P(name, PSTR("hello"));
    /* These start no motor and are accepted at any time. */
    bool any_time = greeting || !strcmp_P(name, PSTR("stop")) || !strcmp_P(name, PSTR("where"));
    if (!any_time && number == late_last_number() && last_answer[0]) {
        line_send(last_answer);
        return;
    }
    if (any_time || !late(number, count > 3 ? fields[3] : "", now_us)) {
        uint8_t first = greeting ? 3 : 4;
        carry_out(name, fields + first, count > first ? count - first : 0);
        if (!any_time) {
            late_take(number);
            strcpy(last_answer, answer);
        }
    }
    line_send(answer);
}
