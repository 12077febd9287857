/* The one answer to the command in hand. */
#pragma once

#include <avr/pgmspace.h>
#include <stdbool.h>
#include <stdint.h>

#define LONGEST_ANSWER 130

extern char answer[LONGEST_ANSWER];

/* Take note of the command in hand: its number as it came, and when it was taken. */
void answer_to(const char *number_of_command, uint32_t time_us);
uint32_t answer_time_us(void);

/* Begin an answer: 'A' accepted, 'N' refused. */
void answer_begin(char letter);

/* Refuse the command in hand; false, so that it can be returned. */
bool refuse_P(PGM_P reason);
#define refuse(reason) refuse_P(PSTR(reason))

/* Read fields as finite numbers; refuses another count of them. */
bool numbers(char **fields, uint8_t count, float *values, uint8_t wanted);
