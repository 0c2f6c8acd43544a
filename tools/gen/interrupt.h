/* SPDX-License-Identifier: MIT */
/** interrupt.h - SIGINT and SIGTERM become a flag that long work looks at.  Threads: any. */
#ifndef TOOLS_GEN_INTERRUPT_H
#define TOOLS_GEN_INTERRUPT_H

#include <stdbool.h>

/** Set by the first signal and never cleared. */
extern volatile bool interrupted;

/** Call once, first thing in main(). */
void interrupt_catch(void);

#endif /* TOOLS_GEN_INTERRUPT_H */
