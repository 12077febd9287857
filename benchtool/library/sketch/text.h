/* Text and numbers, appended; printf of floats needs linker flags that the Arduino IDE lacks. */
#pragma once

#include <avr/pgmspace.h>
#include <stdint.h>
#include <string.h>

/* Append words that are written in the program; they stay in flash. */
#define add_words(text, words) strcat_P(text, PSTR(words))

/* Append a number with at most so many decimals, trailing zeros left out. */
void add_number(char *text, float value, uint8_t decimals);

/* Append a whole number; a float has digits for seven places only. */
void add_whole(char *text, int32_t value);
void add_count(char *text, uint32_t value);

/* Append a number as four hexadecimal digits. */
void add_hex(char *text, uint16_t value);
