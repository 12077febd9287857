/* Pin assignment; the only file with pins. Arduino names in the comments. */
#pragma once

#include <avr/io.h>

/* ESC signals are outputs of timer 1; these two pins are fixed. */
#define ESC_DDR DDRB
#define ESC_1 PB1 /* D9,  OC1A: ESC of motor 1 */
#define ESC_2 PB2 /* D10, OC1B: ESC of motor 2 */

/* Speed sensors need the external interrupts; these two pins are fixed. */
#define RPM_PORT PORTD
#define RPM_1 PD2 /* D2, INT0: speed sensor of rotor 1 */
#define RPM_2 PD3 /* D3, INT1: speed sensor of rotor 2 */

/* HX711 load-cell amplifier; its RATE pin to 5 V for 80 readings a second. */
#define CELL_PORT PORTD
#define CELL_DDR DDRD
#define CELL_PIN PIND
#define CELL_DATA PD6  /* D6: DT or DOUT */
#define CELL_CLOCK PD7 /* D7: SCK */

/* Battery through a divider, 1.1 V at most: 100 kohm to the battery, 6.8 kohm to ground. */
#define VOLTAGE_CHANNEL 0 /* A0 */
