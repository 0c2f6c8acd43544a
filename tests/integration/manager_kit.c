/* SPDX-License-Identifier: MIT */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <limits.h>
#include <stdio.h>
#include <stdlib.h>

#include "tests/integration/manager_kit.h"

struct manager *kit_manager_create(const char *folder)
{
	struct manager *manager;
	struct why why;

	if (manager_create(folder, &manager, &why) < 0)
		fail_msg("%s", why.text);
	return manager;
}

void kit_manager_start(struct manager *manager, const char *const *options)
{
	char program[PATH_MAX];
	struct why why;

	(void)snprintf(program, sizeof(program), "%s/oocd", getenv("OOCD_BIN"));
	if (manager_start(manager, program, options, &why) < 0)
		fail_msg("%s", why.text);
}

void kit_manager_await(struct manager *manager, const char *part, uint32_t count)
{
	if (!manager_await(manager, part, count))
		fail_msg("the daemon does not come to %u of \"%s\"", count, part);
}

void kit_manager_await_kept(struct manager *manager, const char *part, uint32_t count)
{
	if (!manager_await_kept(manager, part, count))
		fail_msg("the daemon does not come to %u kept of \"%s\"", count, part);
}
