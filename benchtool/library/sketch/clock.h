/* Device time and its timer. */
#pragma once

#include <stdint.h>

/* Timer 1 counts one ESC pulse period in steps of 0.5 us: F_CPU / 8. */
#define TICKS_PER_US 2
#define PERIOD_TICKS ((uint16_t)(PULSE_PERIOD_US * TICKS_PER_US))

/* Start timer 1; motors_start() connects the ESC outputs. */
void clock_start(void);

/* Microseconds since power-on; wraps after 71.6 minutes. May be called from interrupts. */
uint32_t clock_us(void);
