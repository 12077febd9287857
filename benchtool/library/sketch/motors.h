/* ESC pulses, made by timer 1. */
#pragma once

#include <stdbool.h>
#include <stdint.h>

/* Put the stop pulse on every ESC output. */
void motors_start(void);

/* Set every motor's pulse; with interrupts off. The caller has checked the range. */
void motors_set(const float *pulses_us);

/* Put every motor at the stop pulse, from the next pulse on. May be called from interrupts. */
void motors_zero(void);

/* Whether any pulse is above the stop pulse. May be called from interrupts. */
bool motors_run(void);

/* The pulse that a motor is told: us. */
float motor_us(uint8_t motor);
