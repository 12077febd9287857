/* What the host may ask for, each number carried out once. */
#pragma once

/* Take one valid payload. */
void commands_take(char *payload);
