/* Rejection of late commands. */
#pragma once

#include <stdbool.h>
#include <stdint.h>

/* Number of the last timely command, or of the hello. */
uint32_t late_last_number(void);
void late_take(uint32_t number);

/* Treat commands from before this stop as late. */
void late_note_stop(uint32_t now_us);

/* Forget a stop older than any valid command, before the clock wraps. */
void late_forget(uint32_t now_us);

/* Reject a late command: by number, by age, or because of a later stop. */
bool late(uint32_t number, const char *time, uint32_t now_us);

/* Parse an integer of at most 32 bits. */
bool whole_number(const char *text, uint32_t *value);
