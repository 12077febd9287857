/* Automatic stop of the motors: host timeout, limits, load cell timeout. */
#pragma once

#include <stdbool.h>
#include <stdint.h>

/* Record the reception of a valid line. */
void guard_hear(void);

/* Stop and latch on host timeout while motors run; called by the timer interrupt. */
void guard_watch(uint32_t now_us);

/* Check a new reading against its limits; nan means no reading. */
void guard_thrust(float thrust_N);
void guard_rpm(uint8_t rotor, float rpm);
void guard_voltage(float voltage_V);

/* Stop and latch on load cell timeout while motors run. */
void guard_cell_silence(uint32_t silent_us);

/* Send the reason of a stop, immediately and every second while latched. */
void guard_report(void);

/* Set all motors unless latched; returns true if they were set. */
bool guard_set_motors(const float *pulses_us);

/* Return true if the motors are latched at the stop pulse. */
bool guard_latched(void);

/* Reason of the last stop as "kind,text"; empty before the first one. */
const char *guard_reason(void);

/* Release the latch. */
void guard_clear(void);

/* Limits: number, names, current values. */
#define LIMITS 4
const char *limit_name(uint8_t index); /* in flash */
float limit_value(uint8_t index);

/* Narrow a limit; returns false, without change, for a wider one. */
bool limit_narrow(uint8_t index, float value);

/* Current maximum pulse width: us. */
float limit_pwm_us(void);
