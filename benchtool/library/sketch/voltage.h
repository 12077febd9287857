/* Battery voltage from a divider and the ADC. */
#pragma once

#include <stdbool.h>

void voltage_start(void);

/* Last conversion: V. Starts the next one, without waiting. */
float voltage_take(void);
