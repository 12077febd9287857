/* Commands of the host; each number is executed once. */
#pragma once

/* Process one valid payload. */
void commands_take(char *payload);
