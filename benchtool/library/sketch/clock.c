#include "settings.h"

#include "clock.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>

#include "guard.h"

#if F_CPU != 16000000UL
#error "the timers are laid out for a 16 MHz board"
#endif

static volatile uint32_t period_start_us;

void clock_start(void)
{
    /* Fast PWM up to ICR1 (mode 14): hardware pulses, independent of the program. */
    TCCR1A |= _BV(WGM11);
    ICR1 = PERIOD_TICKS - 1;
    TCNT1 = 0;
    TIMSK1 = _BV(TOIE1);
    TCCR1B = _BV(WGM13) | _BV(WGM12) | _BV(CS11);
}

uint32_t clock_us(void)
{
    uint32_t start_us;
    uint16_t ticks;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
    {
        start_us = period_start_us;
        ticks = TCNT1;
        /* The period may have ended with its interrupt pending. */
        if ((TIFR1 & _BV(TOV1)) && ticks < PERIOD_TICKS / 2)
            start_us += PULSE_PERIOD_US;
    }
    return start_us + ticks / TICKS_PER_US;
}

/* Watchdog, here independent of sensors and of incomplete lines. */
ISR(TIMER1_OVF_vect)
{
    period_start_us += PULSE_PERIOD_US;
    guard_watch(clock_us());
}
