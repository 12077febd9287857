/* Rotor speeds from timed edges of a sensor. */
#pragma once

#include <stdint.h>

void rpm_start(void);

/* Mean speed since the last call: rpm; 0 at standstill, nan without a new edge. */
float rpm_take(uint8_t rotor);
