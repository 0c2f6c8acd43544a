/* SPDX-License-Identifier: MIT */
/* A new configuration while the daemon serves. */
#include <errno.h>
#include <fcntl.h>
#include <string.h>

#include "daemon/server/memory.h"
#include "daemon/server/server_private.h"
#include "formats/base/bytes.h"
#include "formats/base/file.h"
#include "formats/base/log.h"
#include "formats/base/text.h"

/* What the cache has is available to it. */
static int judge_cache(const struct server *server, uint64_t cache_bytes, struct why *why)
{
	char wanted[TEXT_SIZE_BYTES];
	char available[TEXT_SIZE_BYTES];
	struct memory memory;
	uint64_t bytes;

	LIST_FOR_EACH (link, &server->cache.stores) {
		const struct served *served = LIST_ENTRY(link, struct served, link);

		if (cache_bytes > 0 && cache_bytes < served->arena.segment_bytes)
			return why_set(why, -ENOBUFS,
				       "%s is open and takes memory in pieces of %s: give a larger "
				       "cache-size, or restart",
				       served->path,
				       text_from_size(served->arena.segment_bytes, wanted));
	}
	memory_read(&memory);
	if (__builtin_add_overflow(memory.bytes, server->cache.segment_bytes, &bytes) ||
	    cache_bytes <= bytes)
		return 0;
	return why_set(why, -ENOMEM, "a cache of %s cannot be had: %s leaves %s",
		       text_from_size(cache_bytes, wanted), memory.limited_by,
		       text_from_size(bytes, available));
}

/* Named stores must be files that can be read; what else is wrong with them shows on a worker. */
static int judge_stores(const struct server_config *config, struct why *why)
{
	for (uint32_t i = 0; i < config->store_count; i++) {
		AUTO_FD fd = open(config->stores[i], O_RDONLY | O_CLOEXEC | O_NOCTTY | O_NONBLOCK);
		dev_t device;
		ino_t inode;
		int r;

		if (fd < 0)
			return why_errno(why, -errno, "%s", config->stores[i]);
		r = served_identify(fd, &device, &inode, why);
		if (r < 0) {
			why_prefix(why, "%s", config->stores[i]);
			return r;
		}
	}
	return 0;
}

static void take_cache_size(struct server *server, uint64_t cache_bytes)
{
	if (cache_bytes == 0 || cache_bytes == server->config.cache_bytes)
		return;
	server->config.cache_bytes = cache_bytes;
	cache_set_budget(&server->cache, cache_bytes);
	room_note_change(&server->room);
}

static bool is_named(const struct server_config *config, const char *path)
{
	for (uint32_t i = 0; i < config->store_count; i++)
		if (strcmp(config->stores[i], path) == 0)
			return true;
	return false;
}

/* What is named no longer is closed when it has been idle for as long as any other. */
static void take_stores(struct server *server, const struct server_config *wanted)
{
	struct why why;

	LIST_FOR_EACH (link, &server->cache.stores) {
		struct served *served = LIST_ENTRY(link, struct served, link);

		served->keep = served->keep && is_named(wanted, served->path);
	}
	for (uint32_t i = 0; i < wanted->store_count; i++)
		if (server_want_store(server, wanted->stores[i], &why) < 0)
			log_error("reload: %s", why.text);
}

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
	r = judge_cache(server, wanted.cache_bytes, why);
	if (r == 0)
		r = judge_stores(&wanted, why);
	if (r < 0) {
		config->reload_done(config->reload_arg, false);
		return r;
	}
	config->idle_exit_s = wanted.idle_exit_s;
	config->idle_close_s = wanted.idle_close_s;
	config->policies = wanted.policies;
	config->policy_count = wanted.policy_count;
	accounts_set_policies(&server->accounts, wanted.policies, wanted.policy_count);
	config->admin_gid = wanted.admin_gid;
	config->stores = wanted.stores;
	config->store_count = wanted.store_count;
	take_cache_size(server, wanted.cache_bytes);
	take_stores(server, &wanted);
	config->reload_done(config->reload_arg, true);
	server_active(server);
	return 0;
}
