/* SPDX-License-Identifier: MIT */
#include <errno.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "formats/base/check.h"
#include "formats/base/clock.h"
#include "formats/base/file.h"
#include "libclient/client_private.h"

/** Messages taken in one call: as many as tell of every segment, so that a flood ends. */
#define RUN_MESSAGES_MAX WIRE_SEGMENT_COUNT_MAX
/** While another program starts the daemon, or its socket is not there yet. */
#define STARTING_WAIT_NS (2 * NS_PER_MS)

/* ---- out ---- */

int session_send(struct ooc_client *client, const void *message, size_t message_bytes,
		 const int *fds, size_t fd_count)
{
	int r;

	if (client->socket_fd < 0)
		return -ENOTCONN;
	r = wire_send(client->socket_fd, message, message_bytes, fds, fd_count);
	if (r == 0)
		client->counters.messages_sent++;
	if (r == -EAGAIN)
		client->blocked = true;
	if (r == 0 || r == -EAGAIN)
		return r;
	(void)why_errno(&client->why, r, "the daemon is gone");
	session_lose(client);
	return -ENOTCONN;
}

static void retry_later(struct ooc_client *client)
{
	client->retry_at_ns = clock_now_ns() + client->retry_wait_ns;
	client->retry_wait_ns = u64_min(2 * client->retry_wait_ns, RETRY_WAIT_MAX_NS);
}

void session_lose(struct ooc_client *client)
{
	if (client->state == SESSION_AWAY)
		return;
	client->socket_fd = fd_close(client->socket_fd);
	client->state = SESSION_AWAY;
	client->blocked = false;
	retry_later(client);
	answer_lose(client);
	client->unanswered_opens = 0;
	client->unsent_closes = 0;
	/*
	 * What is drawable stays so: page, grants and directory are left as the daemon left them, and
	 * client_view.c looks there until the next WELCOME.
	 */
}

static int connect_at(struct ooc_client *client, const char *path)
{
	struct sockaddr_un address = { .sun_family = AF_UNIX };
	struct wire_hello hello = { .version = WIRE_VERSION };
	int fd;
	int r;

	fd = socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
	if (fd < 0)
		return why_errno(&client->why, -errno, "cannot make a socket");
	memcpy(address.sun_path, path, strlen(path) + 1);
	if (connect(fd, (const struct sockaddr *)&address, sizeof(address)) < 0) {
		r = -errno;
		(void)fd_close(fd);
		/* A socket of another kind stands there: that is no daemon. */
		return why_errno(&client->why, r == -EPROTOTYPE ? -ECONNREFUSED : r,
				 "cannot reach a daemon at %s", path);
	}
	client->socket_fd = fd;
	client->taken_count = 0;
	client->state = SESSION_GREETING;
	client->greeting_deadline_ns = clock_now_ns() + GREETING_TIMEOUT_NS;
	memcpy(hello.name, client->name, sizeof(hello.name));
	wire_header_init(&hello.header, WIRE_HELLO, sizeof(hello));
	return session_send(client, &hello, sizeof(hello), NULL, 0);
}

/* Tries each place; where nobody listens at any, helps a daemon into being. */
static int connect_anywhere(struct ooc_client *client)
{
	const char *last = client->socket_paths[client->socket_path_count - 1];
	int r = -ENOENT;

	for (size_t i = 0; i < client->socket_path_count && r < 0; i++) {
		const char *path = client->socket_paths[i];

		if (path == last && client->own_folder) {
			r = starter_check_folder(path, &client->why);
			if (r < 0)
				return r;
		}
		r = connect_at(client, path);
	}
	if (client->may_start && (r == -ECONNREFUSED || r == -ENOENT)) {
		r = starter_step(&client->starter, last, &client->why);
		if (r == -EAGAIN)
			return r;
	}
	starter_done(&client->starter);
	return r;
}

int session_connect(struct ooc_client *client)
{
	int r = connect_anywhere(client);

	if (r == -EAGAIN)
		client->retry_at_ns = clock_now_ns() + STARTING_WAIT_NS;
	else if (r < 0)
		retry_later(client);
	return r;
}

/* ---- in ---- */

static int take_welcome(struct ooc_client *client, const struct wire_welcome *welcome, int page_fd)
{
	struct mapping page;
	int r;

	if (client->state != SESSION_GREETING)
		return why_set(&client->why, -EPROTO, "the daemon greets twice");
	if (welcome->version != WIRE_VERSION)
		return why_set(&client->why, -EPROTONOSUPPORT,
			       "the daemon speaks version %u of the protocol, this library %u",
			       welcome->version, WIRE_VERSION);
	r = mapping_init(page_fd, welcome->page_bytes, &page, &client->why);
	if (r < 0)
		return r;

	/* Before the page goes that says what was acknowledged in the session before. */
	for (uint32_t i = 0; i < WIRE_STORE_COUNT_MAX; i++) {
		struct ooc_store *store = client->stores[i];

		if (!store || store->state == STORE_LOST)
			continue;
		view_grow_old(store);
		store->state = STORE_UNASKED;
	}
	mapping_done(&client->page);
	client->page = page;
	client->epoch = welcome->epoch;
	client->state = SESSION_LIVE;
	client->retry_wait_ns = RETRY_WAIT_MIN_NS;
	if (client->was_live)
		client->counters.reconnects++;
	client->was_live = true;
	set_restart(client);
	return 0;
}

/* Returns: 0, or the error that ends the session. */
static int take_error(struct ooc_client *client, const struct wire_error *error)
{
	(void)why_set(&client->why, error->error, "%s", error->text);
	switch (error->type) {
	case WIRE_OPEN:
		if (error->store >= WIRE_STORE_COUNT_MAX)
			return -EPROTO;
		store_take_error(client, error);
		return 0;
	case WIRE_STATUS:
	case WIRE_ADMIN:
		answer_take_error(client, error);
		return 0;
	case WIRE_HELLO:
		if (error->error == -EPROTONOSUPPORT)
			(void)why_set(&client->why, error->error,
				      "the daemon speaks version %u of the protocol, this library "
				      "%u: bring both to the same release",
				      error->version, WIRE_VERSION);
		return error->error;
	default:
		return error->error;
	}
}

static int take_message(struct ooc_client *client, const void *message, const int *fds)
{
	const struct wire_header *header = message;
	const struct wire_segment *segment = message;
	const struct wire_segment_gone *gone = message;
	struct ooc_store *store;

	if (client->state == SESSION_GREETING && header->type != WIRE_WELCOME &&
	    header->type != WIRE_ERROR)
		return why_set(&client->why, -EPROTO, "the daemon begins with %s",
			       wire_type_name(header->type));
	switch (header->type) {
	case WIRE_WELCOME:
		return take_welcome(client, message, fds[0]);
	case WIRE_OPENED:
		return store_take_opened(client, message, fds);
	case WIRE_SEGMENT:
		/* What is said of a store that was closed meanwhile is of no interest. */
		store = client->stores[segment->store];
		return store && store->view ? view_take_segment(store, segment, fds[0]) : 0;
	case WIRE_SEGMENT_GONE:
		store = client->stores[gone->store];
		if (store && store->view)
			view_take_segment_gone(store, gone->segment);
		return 0;
	case WIRE_NOT_NOW:
		set_take_not_now(client, message);
		return 0;
	case WIRE_RECALL:
		set_take_recall(client);
		return 0;
	case WIRE_TEXT:
		return answer_take_text(client, message);
	case WIRE_NODES:
		return answer_take_nodes(client, message);
	case WIRE_ERROR:
		return take_error(client, message);
	case WIRE_EVENT:
		/* It has made the socket readable: that is all it is for. */
		return 0;
	default:
		return why_set(&client->why, -EPROTO, "the daemon sends %s",
			       wire_type_name(header->type));
	}
}

/* Returns: 1 when a message was taken, 0 when there is none, or the error that ends the session. */
static int take_next(struct ooc_client *client)
{
	int fds[WIRE_FD_COUNT_MAX];
	size_t fd_count = 0;
	int r;

	r = wire_receive(client->socket_fd, client->incoming, fds, &fd_count);
	if (r == -EAGAIN)
		return 0;
	if (r == 0)
		return why_set(&client->why, -ENOTCONN, "the daemon has hung up");
	if (r < 0)
		return why_errno(&client->why, r, "cannot take what the daemon sends");
	r = wire_check(WIRE_FROM_DAEMON, client->incoming, (size_t)r, fd_count, &client->why);
	if (r == 0)
		r = take_message(client, client->incoming, fds);
	else
		why_prefix(&client->why, "the daemon breaks the protocol");
	client->taken_count++;
	/* A mapping needs its descriptor no longer. */
	for (size_t i = 0; i < fd_count; i++)
		(void)fd_close(fds[i]);
	return r < 0 ? r : 1;
}

/* Stores are opened again one after the other, as far as the socket has room. */
static void ask_stores(struct ooc_client *client)
{
	for (uint32_t i = 0; i < WIRE_STORE_COUNT_MAX && client->state == SESSION_LIVE; i++) {
		if (client->stores[i] && client->stores[i]->state == STORE_UNASKED &&
		    store_ask(client->stores[i]) < 0)
			return;
	}
}

/* Once the newest set is settled nobody misses what the session before had. */
static void forget_old_views(struct ooc_client *client, uint64_t settled)
{
	if (settled < client->set.sent || client->set.unsaid)
		return;
	for (uint32_t i = 0; i < WIRE_STORE_COUNT_MAX; i++) {
		struct ooc_store *store = client->stores[i];

		if (store && store->old_views && store->state == STORE_OPEN)
			view_forget_old(store);
	}
}

/*
 * Whoever draws frame after frame comes here each time, and almost always for nothing: that there is no
 * message can be seen in shared memory, without a system call.
 */
static bool nothing_has_come(struct ooc_client *client)
{
	const struct wire_session_page *page = session_page(client);
	uint64_t now_ns;
	uint64_t beat;

	/* Pairs with the daemon's release of the count, once the message is in the socket. */
	if (client->state != SESSION_LIVE || set_wants_events(client) ||
	    atomic_load_explicit(&page->message_count, memory_order_acquire) !=
		    client->taken_count ||
	    atomic_load_explicit(&page->epoch, memory_order_acquire) != client->epoch)
		return false;
	now_ns = clock_now_ns();
	beat = atomic_load_explicit(&page->beat, memory_order_relaxed);
	if (beat != client->beat) {
		client->beat = beat;
		client->look_at_ns = now_ns + SILENCE_NS;
	}
	if (now_ns < client->look_at_ns)
		return true;
	client->look_at_ns = now_ns + LOOK_NS;
	return false;
}

int session_run(struct ooc_client *client)
{
	uint64_t settled = 0;
	int r;

	if (client->state == SESSION_AWAY)
		return -ENOTCONN;
	/*
	 * Read before the messages are: what the daemon sent before it said "settled" (segments, above
	 * all) is then known as well.  Pairs with the daemon's release store.
	 */
	if (client->state == SESSION_LIVE)
		settled =
			atomic_load_explicit(&session_page(client)->settled, memory_order_acquire);
	r = nothing_has_come(client) ? 0 : 1;
	for (unsigned i = 0; i < RUN_MESSAGES_MAX && r > 0; i++)
		r = take_next(client);
	if (r >= 0 && client->state == SESSION_GREETING &&
	    clock_now_ns() >= client->greeting_deadline_ns)
		r = why_set(&client->why, -ETIMEDOUT,
			    "whoever listens there does not answer as a daemon does");
	if (r < 0) {
		session_lose(client);
		return r;
	}
	if (client->state != SESSION_LIVE)
		return 0;
	client->blocked = false;
	forget_old_views(client, settled);
	store_flush_closes(client);
	ask_stores(client);
	set_flush(client);
	/* Sending may have shown that the daemon is gone. */
	return client->state == SESSION_AWAY ? -ENOTCONN : 0;
}

/* Milliseconds, rounded up: to wake early would be to wake twice. */
static int poll_timeout(uint64_t until_ns)
{
	uint64_t now_ns = clock_now_ns();
	uint64_t wait_ms;

	if (until_ns <= now_ns)
		return 0;
	wait_ms = (until_ns - now_ns + NS_PER_MS - 1) / NS_PER_MS;
	return (int)u64_min(wait_ms, 60 * 1000);
}

void session_pause(struct ooc_client *client, uint64_t deadline_ns)
{
	struct pollfd socket = {
		.fd = client->socket_fd,
		.events = (short)(POLLIN | (client->blocked ? POLLOUT : 0)),
	};

	if (client->state == SESSION_AWAY)
		deadline_ns = u64_min(deadline_ns, client->retry_at_ns);
	if (client->state == SESSION_GREETING)
		deadline_ns = u64_min(deadline_ns, client->greeting_deadline_ns);
	(void)poll(&socket, 1, poll_timeout(deadline_ns));
	client->look_at_ns = 0;
}
