#include "settings.h"

#include "load_cell.h"

#include <math.h>
#include <util/atomic.h>
#include <util/delay.h>

#include "clock.h"
#include "pins.h"

#define TARE_READINGS 16 /* 0.2 s at 80 Hz */

static int32_t recent[TARE_READINGS];
static uint8_t position, known;
static float zero_counts = NAN; /* the offset of an HX711 is arbitrary: no thrust before a tare */
static uint32_t read_us;

void cell_start(void)
{
    CELL_DDR |= _BV(CELL_CLOCK);
    CELL_PORT |= _BV(CELL_DATA); /* pull-up: no values without an amplifier */
}

/* One clock pulse, without interrupts: more than 60 us high switches the HX711 off. */
static bool next_bit(void)
{
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
    {
        CELL_PORT |= _BV(CELL_CLOCK);
        _delay_us(1);
        CELL_PORT &= ~_BV(CELL_CLOCK);
    }
    _delay_us(1);
    return CELL_PIN & _BV(CELL_DATA);
}

bool cell_poll(void)
{
    if (CELL_PIN & _BV(CELL_DATA))
        return false;
    uint32_t counts = 0;
    for (uint8_t bit = 0; bit < 24; bit++)
        counts = counts << 1 | next_bit();
    next_bit(); /* 25th pulse: channel A, gain 128 */
    if (counts & 0x800000)
        counts |= 0xFF000000;
    position = (position + 1) % TARE_READINGS;
    recent[position] = (int32_t)counts;
    if (known < TARE_READINGS && ++known == TARE_READINGS && isnan(zero_counts))
        cell_tare(); /* automatic first tare, 0.2 s after power-on */
    read_us = clock_us();
    return true;
}

int32_t cell_counts(void) { return recent[position]; }

float cell_thrust_N(void) { return (recent[position] - zero_counts) * NEWTON_PER_COUNT; }

uint32_t cell_time_us(void) { return read_us; }

bool cell_tare(void)
{
    if (!known)
        return false;
    float sum = 0.0f;
    for (uint8_t back = 0; back < known; back++)
        sum += recent[(uint8_t)(position - back) % TARE_READINGS];
    zero_counts = sum / known;
    return true;
}
