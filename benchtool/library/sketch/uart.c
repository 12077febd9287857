#include "settings.h"

#include "uart.h"

#include <avr/interrupt.h>
#include <avr/io.h>

/* Single-byte positions wrap automatically and change atomically. */
static volatile uint8_t in[128], out[256];
static volatile uint8_t in_head, in_tail, out_head, out_tail;

void uart_start(void)
{
    UBRR0 = (F_CPU + BAUD * 4UL) / (BAUD * 8UL) - 1;
    UCSR0A = _BV(U2X0);
    UCSR0C = _BV(UCSZ01) | _BV(UCSZ00);
    UCSR0B = _BV(RXEN0) | _BV(TXEN0) | _BV(RXCIE0);
}

ISR(USART_RX_vect)
{
    uint8_t byte = UDR0;
    uint8_t next = (in_head + 1) % sizeof in;
    /* A full buffer drops the byte: the checksum of its line fails and the host retries. */
    if (next != in_tail) {
        in[in_head] = byte;
        in_head = next;
    }
}

ISR(USART_UDRE_vect)
{
    if (out_head == out_tail)
        UCSR0B &= ~_BV(UDRIE0);
    else
        UDR0 = out[out_tail++];
}

int16_t uart_take(void)
{
    if (in_head == in_tail)
        return -1;
    uint8_t byte = in[in_tail];
    in_tail = (in_tail + 1) % sizeof in;
    return byte;
}

uint8_t uart_room(void) { return (uint8_t)(out_tail - out_head - 1); }

void uart_send(const char *text)
{
    for (; *text; text++) {
        while (!uart_room())
            ;
        out[out_head] = *text;
        out_head++;
        UCSR0B |= _BV(UDRIE0);
    }
}
