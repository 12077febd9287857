/* HX711: raw counts, and thrust since the tare. */
#pragma once

#include <stdbool.h>
#include <stdint.h>

void cell_start(void);

/* Read a new value of the amplifier without waiting; returns true if there was one. */
bool cell_poll(void);

/* Last reading: counts, without tare. */
int32_t cell_counts(void);

/* Last reading since the tare: N; nan before the first. */
float cell_thrust_N(void);

/* Device time of the last reading: us. */
uint32_t cell_time_us(void);

/* Tare to the mean of the last readings; rejected before the first reading. */
bool cell_tare(void);
