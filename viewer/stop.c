/* SPDX-License-Identifier: MIT */
#include "viewer/stop.h"

#include <signal.h>
#include <stddef.h>

static volatile sig_atomic_t requested;

static void on_signal(int number)
{
	(void)number;
	requested = 1;
}

void stop_init(void)
{
	/* Not SA_RESTART: whoever waits shall see it.  Reset: the second signal has its usual effect. */
	struct sigaction action = { .sa_handler = on_signal, .sa_flags = (int)SA_RESETHAND };

	(void)sigemptyset(&action.sa_mask);
	(void)sigaction(SIGINT, &action, NULL);
	(void)sigaction(SIGTERM, &action, NULL);
}

bool stop_requested(void)
{
	return requested != 0;
}
