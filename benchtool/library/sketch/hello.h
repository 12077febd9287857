/* What the device says of itself. */
#pragma once

#include <stdint.h>

/* Send the lines of the hello, and append their count and the CRC over them to its answer. */
void hello_send(char *answer);
