#include "settings.h"

#include "stream.h"

#include <math.h>
#include <stdbool.h>

#include "clock.h"
#include "guard.h"
#include "line.h"
#include "load_cell.h"
#include "motors.h"
#include "rpm.h"
#include "text.h"
#include "voltage.h"

#define UNASKED_US 10000UL /* interval of limit checks without a stream */
#define TELL_US 1000000UL
#define TEXT_(value) #value
#define TEXT(value) TEXT_(value)

static const char channels[][20] PROGMEM = {
    "pwm1_us,pwm_us," TEXT(RATE_HZ),
#if MOTORS == 2
    "pwm2_us,pwm_us," TEXT(RATE_HZ),
#endif
    "rpm1,rpm," TEXT(RATE_HZ),
#if MOTORS == 2
    "rpm2,rpm," TEXT(RATE_HZ),
#endif
    "thrust_N,N,80",
    "thrust_raw,count,80",
#if HAS_VOLTAGE
    "voltage_V,V," TEXT(RATE_HZ),
#endif
};

static bool wanted;
static uint32_t step_us = UNASKED_US, due_us, told_us;
static uint16_t sequence, dropped;
static bool fresh_cell;

uint8_t stream_channels(void) { return sizeof channels / sizeof *channels; }

const char *stream_channel(uint8_t index) { return channels[index]; }

uint16_t stream_hash(void)
{
    uint16_t crc = CRC_START;
    for (uint8_t index = 0; index < stream_channels(); index++) {
        char line[sizeof *channels + 1];
        strcpy_P(line, channels[index]);
        strcpy(strrchr(line, ','), "\n"); /* without the rate */
        crc = crc_over(crc, line);
    }
    return crc;
}

void stream_rate(float rate_Hz)
{
    wanted = rate_Hz > 0.0f;
    step_us = wanted ? (uint32_t)(1e6f / rate_Hz + 0.5f) : UNASKED_US;
    due_us = clock_us() + step_us;
    dropped = 0;
}

static void add_field(char *payload, float value, uint8_t decimals)
{
    add_words(payload, ",");
    if (!isnan(value))
        add_number(payload, value, decimals);
}

/* Measure all channels once; returns the payload of the sample. */
static void measure(char *payload, uint32_t now_us)
{
    add_words(payload, "S,");
    add_count(payload, sequence);
    add_words(payload, ",");
    add_count(payload, now_us);
    for (uint8_t motor = 0; motor < MOTORS; motor++)
        add_field(payload, motor_us(motor), 1);
    for (uint8_t rotor = 0; rotor < MOTORS; rotor++) {
        float rpm = rpm_take(rotor);
        guard_rpm(rotor, rpm);
        add_field(payload, rpm, 0);
    }
    add_field(payload, fresh_cell ? cell_thrust_N() : NAN, 4);
    add_words(payload, ",");
    if (fresh_cell)
        add_whole(payload, cell_counts());
    fresh_cell = false;
#if HAS_VOLTAGE
    float voltage_V = voltage_take();
    guard_voltage(voltage_V);
    add_field(payload, voltage_V, 2);
#endif
}

void stream_poll(void)
{
    /* The thrust limit is checked for every reading. */
    if (cell_poll()) {
        fresh_cell = true;
        guard_thrust(cell_thrust_N());
    }
    uint32_t now_us = clock_us();
    guard_cell_silence(now_us - cell_time_us());
    if ((int32_t)(now_us - due_us) < 0)
        return;
    for (due_us += step_us; (int32_t)(now_us - due_us) >= 0; due_us += step_us) {
        /* The loop was late: the sample is lost and its number is skipped. */
        sequence++;
        dropped++;
    }
    char payload[FRAME_BYTES + 8] = "";
    measure(payload, now_us);
    if (!wanted)
        return;
    dropped += !line_send_if_room(payload);
    sequence++;
    if (dropped && now_us - told_us >= TELL_US) {
        char event[50] = "";
        add_words(event, "E,dropped,");
        add_count(event, dropped);
        add_words(event, " samples since the stream began");
        line_send(event);
        told_us = now_us;
        dropped = 0;
    }
}
