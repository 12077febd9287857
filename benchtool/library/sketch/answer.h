/* Answer to the current command. */
#pragma once

#include <avr/pgmspace.h>
#include <stdbool.h>
#include <stdint.h>

#define LONGEST_ANSWER 130

extern char answer[LONGEST_ANSWER];

/* Store the number of the current command, as received, and its time. */
void answer_to(const char *number_of_command, uint32_t time_us);
uint32_t answer_time_us(void);

/* Begin an answer: 'A' accepted, 'N' refused. */
void answer_begin(char letter);

/* Reject the current command; returns false. */
bool refuse_P(PGM_P reason);
#define refuse(reason) refuse_P(PSTR(reason))

/* Parse fields as finite numbers; rejects any other number of fields. */
bool numbers(char **fields, uint8_t count, float *values, uint8_t wanted);
