/* The serial port: bytes in and out through rings, so that nobody waits for the wire. */
#pragma once

#include <stdint.h>

void uart_start(void);

/* Take the next byte that came, or -1. */
int16_t uart_take(void);

/* How many bytes fit into the ring at present. */
uint8_t uart_room(void);

/* Send a text; waits while the ring is full, 5 ms at most for a whole ring. */
void uart_send(const char *text);
