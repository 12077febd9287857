/* ESC pulses of timer 1. */
#pragma once

#include <stdbool.h>
#include <stdint.h>

/* Start all ESC outputs with the stop pulse. */
void motors_start(void);

/* Set all pulse widths; with interrupts off. The caller checks the range. */
void motors_set(const float *pulses_us);

/* Set all motors to the stop pulse, from the next pulse on. May be called from interrupts. */
void motors_zero(void);

/* Return true if a pulse is above the stop pulse. May be called from interrupts. */
bool motors_run(void);

/* Commanded pulse width of a motor: us. */
float motor_us(uint8_t motor);
