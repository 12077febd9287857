/* What the device says of itself. */
#pragma once

#include <stdint.h>

/* Send the lines of the hello; returns how many. */
uint8_t hello_send(void);
