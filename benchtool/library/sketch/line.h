/* Lines of the bench protocol: $<payload>*<CRC>. */
#pragma once

#include <stdbool.h>
#include <stdint.h>

/* Go on with a CRC-16/CCITT-FALSE over a text; it starts at CRC_START. */
#define CRC_START 0xFFFF
uint16_t crc_over(uint16_t crc, const char *text);

/* Send a payload as a line. */
void line_send(const char *payload);

/* Send a payload as a line unless it would have to wait; tells whether it was sent. */
bool line_send_if_room(const char *payload);

/* Give the payload of the next valid line that has come whole, or NULL. */
char *line_take(void);
