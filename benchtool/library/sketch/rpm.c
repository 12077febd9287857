#include "settings.h"

#include "rpm.h"

#include <avr/interrupt.h>
#include <math.h>
#include <stdbool.h>
#include <util/atomic.h>

#include "clock.h"
#include "pins.h"

#define REST_US 300000UL /* no edge within this time: standstill */
#define NOISE_US 50      /* closer edges are noise */

struct edges {
    uint32_t from_us, last_us; /* first and last counted edge */
    uint16_t count;            /* edges after the first */
    bool turning;
};
static volatile struct edges rotors[MOTORS];

void rpm_start(void)
{
    RPM_PORT |= _BV(RPM_1) | _BV(RPM_2); /* pull-up for open-collector sensors */
    EICRA = _BV(ISC01) | _BV(ISC11);     /* falling edges */
    EIFR = _BV(INTF0) | _BV(INTF1);
    EIMSK = MOTORS == 2 ? _BV(INT0) | _BV(INT1) : _BV(INT0);
}

static inline void note_edge(uint8_t rotor)
{
    volatile struct edges *edges = &rotors[rotor];
    uint32_t now_us = clock_us();
    if (!edges->turning) {
        edges->turning = true;
        edges->from_us = now_us;
        edges->count = 0;
    } else if (now_us - edges->last_us < NOISE_US) {
        return;
    } else {
        edges->count++;
    }
    edges->last_us = now_us;
}

ISR(INT0_vect) { note_edge(0); }

#if MOTORS == 2
ISR(INT1_vect) { note_edge(1); }
#endif

float rpm_take(uint8_t rotor)
{
    volatile struct edges *edges = &rotors[rotor];
    uint32_t span_us = 0;
    uint16_t count = 0;
    bool turning;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
    {
        if (edges->turning && clock_us() - edges->last_us > REST_US)
            edges->turning = false;
        turning = edges->turning;
        if (turning) {
            count = edges->count;
            span_us = edges->last_us - edges->from_us;
            edges->from_us = edges->last_us;
            edges->count = 0;
        }
    }
    if (!turning)
        return 0.0f;
    return count ? 60e6f / PULSES_PER_TURN * count / span_us : NAN;
}
