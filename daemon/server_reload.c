/* SPDX-License-Identifier: MIT */
/* A new configuration while the daemon serves. */
#include <errno.h>

#include "daemon/server_private.h"

int server_reload(struct server *server, struct why *why)
{
	struct server_config *config = &server->config;
	struct server_config wanted;
	int r;

	if (!config->reload)
		return why_set(why, -EOPNOTSUPP, "no configuration file was given: use --config");
	r = config->reload(config->reload_arg, &wanted, why);
	if (r < 0)
		return r;
	config->idle_exit_s = wanted.idle_exit_s;
	config->idle_close_s = wanted.idle_close_s;
	config->policies = wanted.policies;
	config->policy_count = wanted.policy_count;
	config->admin_gid = wanted.admin_gid;
	return 0;
}
