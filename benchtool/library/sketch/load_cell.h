/* The HX711: counts as it has them, newtons since the tare. */
#pragma once

#include <stdbool.h>
#include <stdint.h>

void cell_start(void);

/* Read the amplifier when it has a new value, without waiting; tells whether it had. */
bool cell_poll(void);

/* The last reading: counts, never tared. */
int32_t cell_counts(void);

/* The last reading since the tare: N; nan before the first. */
float cell_thrust_N(void);

/* When the last reading came: device time in us. */
uint32_t cell_time_us(void);

/* Take the mean of the last readings as zero thrust; refused before the first reading. */
bool cell_tare(void);
