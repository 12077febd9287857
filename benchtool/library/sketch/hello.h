/* Device information. */
#pragma once

#include <stdint.h>

/* Send the lines of the hello; append their number and CRC to its answer. */
void hello_send(char *answer);
