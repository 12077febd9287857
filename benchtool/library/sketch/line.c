#include "line.h"

#include <stddef.h>
#include <stdlib.h>
#include <string.h>
#include <util/crc16.h>

#include "text.h"
#include "uart.h"

#define LONGEST 100 /* commands are shorter; longer lines are discarded */
#define WRAPPING 7  /* $, *, four digits, line end */

static char line[LONGEST + 1];
static uint8_t length;

/* Check value for 123456789: 29B1. */
uint16_t crc_over(uint16_t crc, const char *text)
{
    while (*text)
        crc = _crc_xmodem_update(crc, (uint8_t)*text++);
    return crc;
}

void line_send(const char *payload)
{
    char tail[WRAPPING] = "*";
    add_hex(tail, crc_over(CRC_START, payload));
    strcat(tail, "\n");
    uart_send("$");
    uart_send(payload);
    uart_send(tail);
}

bool line_send_if_room(const char *payload)
{
    if (uart_room() < strlen(payload) + WRAPPING)
        return false;
    line_send(payload);
    return true;
}

/* Check a line in place; returns its payload, or NULL for an invalid line. */
static char *checked(char *text)
{
    char *start = strrchr(text, '$'), *star = start ? strrchr(start, '*') : NULL, *end;
    if (!star || strlen(star + 1) != 4)
        return NULL;
    uint16_t told = (uint16_t)strtoul(star + 1, &end, 16);
    *star = '\0';
    return *end == '\0' && crc_over(CRC_START, start + 1) == told ? start + 1 : NULL;
}

char *line_take(void)
{
    int16_t byte;
    while ((byte = uart_take()) >= 0) {
        if (byte != '\n') {
            /* A line that is too long is discarded; its end alone is invalid. */
            if (length < LONGEST)
                line[length++] = (char)byte;
            continue;
        }
        bool whole = length < LONGEST;
        if (whole && length && line[length - 1] == '\r')
            length--;
        line[length] = '\0';
        length = 0;
        char *payload = whole ? checked(line) : NULL;
        if (payload)
            return payload;
    }
    return NULL;
}
