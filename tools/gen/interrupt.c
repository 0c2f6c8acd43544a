/* SPDX-License-Identifier: MIT */
#include "tools/gen/interrupt.h"

#include <signal.h>
#include <stddef.h>

volatile bool interrupted;

static void on_signal(int signal_number)
{
	(void)signal_number;
	interrupted = true;
}

void interrupt_catch(void)
{
	/* Without SA_RESTART: a write to a pipe that nobody reads must end. */
	struct sigaction action = { .sa_handler = on_signal };

	(void)sigemptyset(&action.sa_mask);
	(void)sigaction(SIGINT, &action, NULL);
	(void)sigaction(SIGTERM, &action, NULL);
	/* A closed pipe is an error of write() like any other. */
	(void)signal(SIGPIPE, SIG_IGN);
}
