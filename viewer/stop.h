/* SPDX-License-Identifier: MIT */
/** stop.h - SIGINT and SIGTERM end the program at the next good moment.  Threads: any. */
#ifndef VIEWER_STOP_H
#define VIEWER_STOP_H

#include <stdbool.h>

/** Takes both signals; a second one ends the program at once. */
void stop_init(void);

/** Has one come? */
bool stop_requested(void);

#endif /* VIEWER_STOP_H */
