/* Which orders come late and are refused. */
#pragma once

#include <stdbool.h>
#include <stdint.h>

/* Number of the last order in time, or of the hello. */
uint32_t late_last_number(void);
void late_take(uint32_t number);

/* What was ordered before this stop is late from now on. */
void late_note_stop(uint32_t now_us);

/* Forget a stop that is older than any order may be, before the clock goes round. */
void late_forget(uint32_t now_us);

/* Refuse an order that comes late: by its number, its age, or a stop after it was given. */
bool late(uint32_t number, const char *time, uint32_t now_us);

/* Read a whole number of at most 32 bits. */
bool whole_number(const char *text, uint32_t *value);
