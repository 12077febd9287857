/* The battery, through a divider and the ADC. */
#pragma once

#include <stdbool.h>

void voltage_start(void);

/* The last conversion: V. Starts the next one, so that nobody waits for it. */
float voltage_take(void);
