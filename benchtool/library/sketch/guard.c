#include "settings.h"

#include "guard.h"

#include <math.h>
#include <util/atomic.h>

#include "clock.h"
#include "line.h"
#include "motors.h"
#include "text.h"

#define REMIND_US 1000000UL
#define CELL_SILENT_US 300000UL /* three readings of an HX711 at 10 Hz */

enum limit { PWM, THRUST, RPM, VOLTAGE_MIN };
static const char names[LIMITS][16] PROGMEM = {"pwm_us", "thrust_N", "rpm", "voltage_min_V"};
static float limits[LIMITS] = {LIMIT_PWM_US, LIMIT_THRUST_N, LIMIT_RPM, LIMIT_VOLTAGE_MIN_V};

static volatile uint32_t heard_us;
static volatile bool latched;       /* pulses above stop are rejected */
static volatile uint32_t silent_us; /* set by the interrupt; the loop formats the text */
static char why[80];                /* "kind,text" as in the event */
static uint32_t told_us;

void guard_hear(void)
{
    uint32_t now_us = clock_us();
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { heard_us = now_us; }
}

void guard_watch(uint32_t now_us)
{
    if (now_us - heard_us < WATCHDOG_MS * 1000UL || !motors_run())
        return;
    motors_zero();
    latched = true;
    silent_us = now_us - heard_us;
}

static void report(void)
{
    char payload[sizeof why + 2] = "";
    add_words(payload, "E,");
    strcat(payload, why);
    line_send(payload);
    told_us = clock_us();
}

/* Stop for an exceeded limit; keeps the first reason. */
static void latch(PGM_P what, float value, float limit)
{
    if (latched)
        return;
    motors_zero();
    latched = true;
    why[0] = '\0';
    add_words(why, "limit,");
    strcat_P(why, what);
    add_words(why, " ");
    add_number(why, value, 3);
    add_words(why, " against limit ");
    add_number(why, limit, 3);
    add_words(why, "; motors stopped");
    report();
}

void guard_thrust(float thrust_N)
{
    if (fabs(thrust_N) > limits[THRUST])
        latch(PSTR("thrust_N"), thrust_N, limits[THRUST]);
}

void guard_rpm(uint8_t rotor, float rpm)
{
    if (rpm > limits[RPM])
        latch(rotor ? PSTR("rpm2") : PSTR("rpm1"), rpm, limits[RPM]);
}

void guard_voltage(float voltage_V)
{
    if (voltage_V < limits[VOLTAGE_MIN])
        latch(PSTR("voltage_V"), voltage_V, limits[VOLTAGE_MIN]);
}

void guard_cell_silence(uint32_t us)
{
    if (us > CELL_SILENT_US && motors_run())
        latch(PSTR("silence of thrust_N in s"), us * 1e-6f, CELL_SILENT_US * 1e-6f);
}

void guard_report(void)
{
    if (!latched)
        return;
    uint32_t silence_us;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
    {
        silence_us = silent_us;
        silent_us = 0;
    }
    if (silence_us) {
        why[0] = '\0';
        add_words(why, "watchdog,no line for ");
        add_number(why, silence_us / 1000, 0);
        add_words(why, " ms; motors stopped");
        report();
    } else if (clock_us() - told_us >= REMIND_US) {
        report();
    }
}

bool guard_set_motors(const float *pulses_us)
{
    bool set = false;
    /* The interrupt may latch at any time: check and set atomically. */
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
    {
        if (!latched) {
            motors_set(pulses_us);
            set = true;
        }
    }
    return set;
}

bool guard_latched(void) { return latched; }

const char *guard_reason(void)
{
    guard_report();
    return why;
}

void guard_clear(void)
{
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
    {
        latched = false;
        silent_us = 0;
    }
}

const char *limit_name(uint8_t index) { return names[index]; }

float limit_value(uint8_t index) { return limits[index]; }

float limit_pwm_us(void) { return limits[PWM]; }

bool limit_narrow(uint8_t index, float value)
{
    bool wider = index == VOLTAGE_MIN ? value < limits[index] : value > limits[index];
    if (!wider)
        limits[index] = value;
    return !wider;
}
