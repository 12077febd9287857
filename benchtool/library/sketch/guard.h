/* What stops the motors without being asked: silence of the host, limits, a silent load cell. */
#pragma once

#include <stdbool.h>
#include <stdint.h>

/* Note that a valid line came. */
void guard_hear(void);

/* Stop and latch when motors run and the host is silent; called by the timer interrupt. */
void guard_watch(uint32_t now_us);

/* Check a new reading against its limits; nan is no reading. */
void guard_thrust(float thrust_N);
void guard_rpm(uint8_t rotor, float rpm);
void guard_voltage(float voltage_V);

/* Stop and latch when motors run and the load cell has said nothing for too long. */
void guard_cell_silence(uint32_t silent_us);

/* Send why the motors were stopped, at once and then every second while the latch holds. */
void guard_report(void);

/* Set all motors unless the latch holds; tells whether they were set. */
bool guard_set_motors(const float *pulses_us);

/* Whether they are held at the stop pulse. */
bool guard_latched(void);

/* Why the motors are held, as "kind,text"; empty before the first time. */
const char *guard_reason(void);

/* Lift the latch. */
void guard_clear(void);

/* The limits, by name: how many, the name, the present value. */
#define LIMITS 4
const char *limit_name(uint8_t index); /* in flash */
float limit_value(uint8_t index);

/* Make a limit narrower; a wider one is not taken. Tells whether it was. */
bool limit_narrow(uint8_t index, float value);

/* The longest pulse allowed at present: us. */
float limit_pwm_us(void);
