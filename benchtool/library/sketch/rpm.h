/* Rotor speeds from the edges of a sensor, each edge with its time. */
#pragma once

#include <stdint.h>

void rpm_start(void);

/* The mean speed since the last call: rpm; 0 at rest, nan when no edge came since. */
float rpm_take(uint8_t rotor);
