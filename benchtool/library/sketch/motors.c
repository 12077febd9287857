#include "settings.h"

#include "motors.h"

#include <avr/io.h>
#include <util/atomic.h>

#include "clock.h"
#include "pins.h"

#define STOP_TICKS ((uint16_t)(PWM_STOP_US * TICKS_PER_US))

static volatile uint16_t pulse_ticks[MOTORS];

/* The timer applies a new width between two pulses. */
static void apply(void)
{
    OCR1A = pulse_ticks[0] - 1;
#if MOTORS == 2
    OCR1B = pulse_ticks[1] - 1;
#endif
}

void motors_start(void)
{
    motors_zero();
    ESC_DDR |= _BV(ESC_1);
    TCCR1A |= _BV(COM1A1);
#if MOTORS == 2
    ESC_DDR |= _BV(ESC_2);
    TCCR1A |= _BV(COM1B1);
#endif
}

void motors_set(const float *pulses_us)
{
    for (uint8_t motor = 0; motor < MOTORS; motor++)
        pulse_ticks[motor] = (uint16_t)(pulses_us[motor] * TICKS_PER_US + 0.5f);
    apply();
}

void motors_zero(void)
{
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
    {
        for (uint8_t motor = 0; motor < MOTORS; motor++)
            pulse_ticks[motor] = STOP_TICKS;
        apply();
    }
}

bool motors_run(void)
{
    bool run = false;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
    {
        for (uint8_t motor = 0; motor < MOTORS; motor++)
            run |= pulse_ticks[motor] > STOP_TICKS;
    }
    return run;
}

float motor_us(uint8_t motor)
{
    uint16_t ticks;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { ticks = pulse_ticks[motor]; }
    return (float)ticks / TICKS_PER_US;
}
