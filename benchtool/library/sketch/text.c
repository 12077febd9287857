#include "text.h"

#include <stdlib.h>

void add_number(char *text, float value, uint8_t decimals)
{
    char *end = text + strlen(text);
    dtostrf(value, 1, decimals, end);
    if (!decimals)
        return;
    char *last = end + strlen(end) - 1;
    while (*last == '0')
        *last-- = '\0';
    if (*last == '.')
        *last = '\0';
}

void add_whole(char *text, int32_t value) { ltoa(value, text + strlen(text), 10); }

void add_count(char *text, uint32_t value) { ultoa(value, text + strlen(text), 10); }

void add_hex(char *text, uint16_t value)
{
    char digits[5];
    utoa(value, digits, 16);
    strcat(text, &"000"[strlen(digits) - 1]);
    strcat(text, strupr(digits));
}
