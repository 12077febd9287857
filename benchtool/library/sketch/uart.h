/* Serial port with ring buffers for both directions. */
#pragma once

#include <stdint.h>

void uart_start(void);

/* Return the next received byte, or -1. */
int16_t uart_take(void);

/* Free bytes in the transmit buffer. */
uint8_t uart_room(void);

/* Send a text; waits while the buffer is full, at most 5 ms for a whole buffer. */
void uart_send(const char *text);
