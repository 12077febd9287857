/* Append text and numbers; printf of floats needs linker flags that the Arduino IDE lacks. */
#pragma once

#include <avr/pgmspace.h>
#include <stdint.h>
#include <string.h>

/* Append a string literal from flash. */
#define add_words(text, words) strcat_P(text, PSTR(words))

/* Append a number with a maximum of decimals, without trailing zeros. */
void add_number(char *text, float value, uint8_t decimals);

/* Append an integer; a float has seven digits only. */
void add_whole(char *text, int32_t value);
void add_count(char *text, uint32_t value);

/* Append a number as four hexadecimal digits. */
void add_hex(char *text, uint16_t value);
