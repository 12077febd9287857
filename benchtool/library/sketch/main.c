/* Rotor bench on one microcontroller: ESC, load cell, speed sensor and bench protocol.

   The loop reads lines, answers commands and measures. Independent of it, the timer interrupt stops
   the motors on host timeout (guard.c), and the watchdog of the chip on a hang of the program. */

#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/wdt.h>
#include <stddef.h>

#include "clock.h"
#include "commands.h"
#include "guard.h"
#include "line.h"
#include "load_cell.h"
#include "motors.h"
#include "rpm.h"
#include "stream.h"
#include "text.h"
#include "uart.h"
#include "voltage.h"

static uint8_t reset_cause __attribute__((section(".noinit")));

/* After a reset the watchdog of the chip continues with 15 ms: disable it first. */
void disarm(void) __attribute__((naked, used, section(".init3")));
void disarm(void)
{
    reset_cause = MCUSR;
    MCUSR = 0;
    wdt_disable();
}

static void tell_boot(void)
{
    char event[40] = "";
    add_words(event, "E,boot,");
    if (reset_cause & _BV(WDRF))
        add_words(event, "the program hung and was reset");
    else
        add_words(event, "started");
    line_send(event);
}

int main(void)
{
    motors_start();
    clock_start();
    uart_start();
    cell_start();
    rpm_start();
    voltage_start();
    wdt_enable(WDTO_120MS);
    sei();
    tell_boot();
    for (;;) {
        wdt_reset();
        char *payload = line_take();
        if (payload != NULL)
            commands_take(payload);
        stream_poll();
        guard_report();
    }
}
