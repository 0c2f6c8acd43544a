/* SPDX-License-Identifier: MIT */
#include <errno.h>
#include <limits.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "formats/base/clock.h"
#include "formats/base/file.h"
#include "libclient/client_private.h"

/** Until a daemon that was started listens, and greets. */
#define CONNECT_TIMEOUT_NS (15 * NS_PER_S)

static _Thread_local struct why connect_why;

static struct ooc_client *client_destroy(struct ooc_client *client)
{
	if (!client)
		return NULL;

	for (uint32_t i = 0; i < WIRE_STORE_COUNT_MAX; i++)
		store_destroy(client->stores[i]);
	client->socket_fd = fd_close(client->socket_fd);
	starter_done(&client->starter);
	mapping_done(&client->page);
	for (size_t i = 0; client->daemon_options[i]; i++)
		free(client->daemon_options[i]);
	free(client->set.entries);
	free(client->set.wants);
	free(client->answer.text);
	free(client);
	return NULL;
}

/* Where to look for the daemon, and whether one may be started. */
static int paths_init(struct ooc_client *client, const char *given)
{
	const char *wanted = getenv("OOCD_SOCKET");
	size_t count = 0;
	int r;

	if (!given && !(wanted && wanted[0]) && access(WIRE_SYSTEM_SOCKET, F_OK) == 0)
		(void)strcpy(client->socket_paths[count++], WIRE_SYSTEM_SOCKET);
	if (given || (wanted && wanted[0]))
		r = wire_socket_path(given, client->socket_paths[count], SOCKET_PATH_BYTES);
	else
		r = wire_user_socket_path(client->socket_paths[count], SOCKET_PATH_BYTES);
	if (r < 0)
		return why_set(&client->why, r, "the path of the daemon's socket is too long");
	client->socket_path_count = count + 1;
	client->own_folder = !given && !(wanted && wanted[0]);
	/* A daemon works in no folder, so it could not find a path that is relative to ours. */
	client->may_start = !given && client->socket_paths[count][0] == '/';
	return 0;
}

static int wait_for_welcome(struct ooc_client *client)
{
	uint64_t deadline_ns = clock_now_ns() + CONNECT_TIMEOUT_NS;
	int r = 0;

	while (client->state != SESSION_LIVE) {
		if (client->state == SESSION_AWAY)
			r = session_connect(client);
		else
			r = session_run(client);
		if (r < 0 && r != -EAGAIN)
			return r;
		if (client->state == SESSION_LIVE)
			break;
		if (clock_now_ns() >= deadline_ns)
			return why_set(&client->why, -ETIMEDOUT, "no daemon answers at %s",
				       client->socket_paths[client->socket_path_count - 1]);
		session_pause(client, deadline_ns);
	}
	return 0;
}

static int options_init(struct ooc_client *client, const char *const *options)
{
	for (size_t i = 0; options && options[i]; i++) {
		if (i == STARTER_OPTION_COUNT_MAX)
			return why_set(&client->why, -E2BIG,
				       "a daemon can be started with %d options at most",
				       STARTER_OPTION_COUNT_MAX);
		client->daemon_options[i] = strdup(options[i]);
		if (!client->daemon_options[i])
			return why_set(&client->why, -ENOMEM, "no memory for a client");
	}
	return 0;
}

int ooc_connect(const char *socket_path, const char *name, struct ooc_client **ret)
{
	return ooc_connect_or_start(socket_path, name, NULL, ret);
}

int ooc_connect_or_start(const char *socket_path, const char *name,
			 const char *const *daemon_options, struct ooc_client **ret)
{
	struct ooc_client *client;
	int r;

	*ret = NULL;
	client = calloc(1, sizeof(*client));
	if (!client)
		return why_set(&connect_why, -ENOMEM, "no memory for a client");
	client->socket_fd = -1;
	client->retry_wait_ns = RETRY_WAIT_MIN_NS;
	starter_init(&client->starter, (const char *const *)client->daemon_options);
	memcpy(client->name, name, strnlen(name, sizeof(client->name) - 1));
	r = paths_init(client, socket_path);
	if (r == 0)
		r = options_init(client, daemon_options);
	if (r == 0)
		r = wait_for_welcome(client);
	if (r < 0) {
		connect_why = client->why;
		client_destroy(client);
		return r;
	}
	*ret = client;
	return 0;
}

struct ooc_client *ooc_disconnect(struct ooc_client *client)
{
	return client_destroy(client);
}

const char *ooc_error_text(const struct ooc_client *client)
{
	return client ? client->why.text : connect_why.text;
}

int ooc_fd(const struct ooc_client *client)
{
	return client->socket_fd;
}

/* One quick attempt, if it is time for one. */
static void reconnect(struct ooc_client *client)
{
	if (clock_now_ns() < client->retry_at_ns)
		return;
	for (uint32_t i = 0; i < WIRE_STORE_COUNT_MAX; i++) {
		/* Threads may still draw from too many: a daemon that comes and goes has to wait. */
		if (client->stores[i] && !view_make_room(client->stores[i]))
			return;
	}
	(void)session_connect(client);
}

int ooc_dispatch(struct ooc_client *client)
{
	if (client->state == SESSION_AWAY)
		reconnect(client);
	if (client->state != SESSION_AWAY)
		(void)session_run(client);
	if (client->state != SESSION_LIVE)
		return -ENOTCONN;
	if (client->a_store_was_lost) {
		client->a_store_was_lost = false;
		return -ESTALE;
	}
	return 0;
}

/* Never, for a timeout below 0. */
static uint64_t deadline_of(int timeout_ms)
{
	return timeout_ms < 0 ? UINT64_MAX : clock_now_ns() + (uint64_t)timeout_ms * NS_PER_MS;
}

int ooc_wait(struct ooc_client *client, int timeout_ms)
{
	uint64_t deadline_ns = deadline_of(timeout_ms);
	struct ooc_progress progress;
	int r = 0;

	for (;;) {
		(void)ooc_dispatch(client);
		ooc_progress(client, &progress);
		if (progress.settled)
			break;
		if (clock_now_ns() >= deadline_ns) {
			r = client->state == SESSION_LIVE ? -ETIMEDOUT : -ENOTCONN;
			break;
		}
		/* From here on the daemon is asked to wake us. */
		client->waiting = true;
		set_flush(client);
		session_pause(client, deadline_ns);
	}
	client->waiting = false;
	return r;
}

void ooc_counters(const struct ooc_client *client, struct ooc_counters *ret)
{
	const struct wire_session_page *page = session_page(client);

	*ret = client->counters;
	/* Figures for people: none has to fit to another. */
	ret->fetched_bytes = atomic_load_explicit(&page->fetched_bytes, memory_order_relaxed);
	ret->prefetched_bytes = atomic_load_explicit(&page->prefetched_bytes, memory_order_relaxed);
	ret->cache_bytes = atomic_load_explicit(&page->cache_bytes, memory_order_relaxed);
	ret->cache_used_bytes = atomic_load_explicit(&page->cache_used_bytes, memory_order_relaxed);
}
