/* Lines of the bench protocol: $<payload>*<CRC>. */
#pragma once

#include <stdbool.h>
#include <stdint.h>

/* Update a CRC-16/CCITT-FALSE with a text; initial value CRC_START. */
#define CRC_START 0xFFFF
uint16_t crc_over(uint16_t crc, const char *text);

/* Send a payload as a line. */
void line_send(const char *payload);

/* Send a payload as a line if it fits the buffer; returns true if it was sent. */
bool line_send_if_room(const char *payload);

/* Return the payload of the next complete valid line, or NULL. */
char *line_take(void);
