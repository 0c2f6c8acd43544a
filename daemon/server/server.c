/* SPDX-License-Identifier: MIT */
#include "daemon/server/server.h"

#include <errno.h>
#include <poll.h>
#include <signal.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/socket.h>
#include <systemd/sd-daemon.h>
#include <time.h>

#include "daemon/cache/recorder.h"
#include "daemon/limits.h"
#include "daemon/server/server_private.h"
#include "daemon/sharing/division.h"
#include "formats/base/check.h"
#include "formats/base/clock.h"
#include "formats/base/file.h"
#include "formats/base/log.h"

/* How often times are looked at, and how exactly: half a tick late, clients begin to look for us. */
#define TICK_US          (WIRE_BEAT_MS * NS_PER_MS / NS_PER_US)
#define TICK_ACCURACY_US (TICK_US / 10)
/* An empty segment that nobody has used for so long is given back. */
#define SEGMENT_IDLE_NS (30 * NS_PER_S)

/* Rounds between two walks through everything, in Debug builds. */
#define CHECK_ROUNDS 64u

/* ---- rounds ---- */

void server_active(struct server *server)
{
	(void)sd_event_source_set_enabled(server->round_source, SD_EVENT_ONESHOT);
}

/* Walks everything, now and then: far too dear for a release. */
static void check_now_and_then(struct server *server)
{
#ifdef OOCD_DEBUG
	if (server->round_count++ % CHECK_ROUNDS > 0)
		return;
	cache_check(&server->cache);
	accounts_check(&server->accounts);
	LIST_FOR_EACH (link, &server->sessions)
		visible_check(&LIST_ENTRY(link, struct session, link)->visible);
#else
	(void)server;
#endif
}

static int on_wake(sd_event_source *source, uint64_t now_us, void *arg)
{
	(void)source;
	(void)now_us;
	server_active(arg);
	return 0;
}

/*
 * Dividing the cache walks all sets.  Where many clients move and want more than fits, it is done for
 * those together that come within some multiple of the time that it takes.
 */
static void settle(struct server *server)
{
	uint64_t spent_ns;

	if (!room_is_unsettled(&server->room) ||
	    (server->room.divided && clock_now_ns() < server->division_after_ns))
		return;
	/* Of the processor: others may have had it meanwhile, which is no reason to wait longer. */
	spent_ns = clock_spent_ns();
	division_settle(&server->room);
	spent_ns = clock_spent_ns() - spent_ns;
	server->division_after_ns = clock_now_ns() + spent_ns * DIVISION_PAUSE;
}

/* Tells all sessions what they are owed, and sees to the next round where something has to wait for it. */
static void tell(struct server *server)
{
	uint64_t event_pause_ns = server->session_count * EVENT_PAUSE_US * NS_PER_US;
	uint64_t now_ns = clock_now_ns();
	uint64_t wake_ns = UINT64_MAX;

	LIST_FOR_EACH (link, &server->sessions) {
		struct session *session = LIST_ENTRY(link, struct session, link);

		wake_ns = u64_min(wake_ns, session_tell(session, now_ns, event_pause_ns));
		if (clock_now_ns() < now_ns + TELL_US_MAX * NS_PER_US)
			continue;
		/* The others come first in the next round. */
		list_rotate(&server->sessions, link);
		server_active(server);
		break;
	}
	/* Sets have changed, or a segment is to be drained, whose holders are told then. */
	if (!server->stopping && room_is_unsettled(&server->room))
		wake_ns = u64_min(wake_ns, server->division_after_ns);
	if (server->listen_at_ns > 0)
		wake_ns = u64_min(wake_ns, server->listen_at_ns);
	if (wake_ns == UINT64_MAX)
		return;
	(void)sd_event_source_set_time(server->wake_source, wake_ns / NS_PER_US + 1);
	(void)sd_event_source_set_enabled(server->wake_source, SD_EVENT_ONESHOT);
}

static void listen_again(struct server *server)
{
	if (server->listen_at_ns == 0 || clock_now_ns() < server->listen_at_ns)
		return;
	server->listen_at_ns = 0;
	(void)sd_event_source_set_enabled(server->listen_source, SD_EVENT_ON);
}

static int on_round(sd_event_source *source, void *arg)
{
	struct server *server = arg;

	(void)source;
	if (!server->stopping) {
		listen_again(server);
		settle(server);
		LIST_FOR_EACH (link, &server->sessions)
			session_retry(LIST_ENTRY(link, struct session, link));
		takeover_pump(server->takeover);
		server_map_inherited(server);
		residents_retry(&server->residents);
		queues_pump(&server->queues);
	}
	fetch_flush(server->fetch);
	tell(server);
	check_now_and_then(server);
	if (server->stopping && fills_count(server->fills) == 0 &&
	    workers_job_count(server->workers) == 0)
		(void)sd_event_exit(server->event, 0);
	return 0;
}

static void stop(struct server *server)
{
	if (server->stopping)
		return;
	server->stopping = true;
	(void)sd_event_source_set_enabled(server->listen_source, SD_EVENT_OFF);
	LIST_FOR_EACH (link, &server->sessions)
		session_freeze(LIST_ENTRY(link, struct session, link));
	server_active(server);
}

static void tick_idle(struct server *server, uint64_t now_ns)
{
	if (server->session_count > 0)
		server->idle_since_ns = 0;
	else if (server->idle_since_ns == 0)
		server->idle_since_ns = now_ns;
	else if (server->config.idle_exit_s > 0 &&
		 now_ns - server->idle_since_ns > server->config.idle_exit_s * NS_PER_S)
		stop(server);
}

static int on_tick(sd_event_source *source, uint64_t now_us, void *arg)
{
	struct server *server = arg;
	uint64_t used_bytes = cache_used_bytes(&server->cache);
	uint64_t now_ns = clock_now_ns();

	recorder_tick(server->cache.recorder);
	room_tick(&server->room, now_ns);
	LIST_FOR_EACH (link, &server->sessions)
		session_tick(LIST_ENTRY(link, struct session, link), now_ns, used_bytes);
	if (!server->stopping) {
		takeover_tick(server->takeover, now_ns);
		server_close_idle(server, now_ns);
		server_metrics_tick(server, now_ns);
		cache_trim(&server->cache, now_ns, SEGMENT_IDLE_NS);
		tick_idle(server, now_ns);
		/* It may have been switched off for want of descriptors. */
		(void)sd_event_source_set_enabled(server->listen_source, SD_EVENT_ON);
	}
	notify_tick(&server->notify, server, now_ns);
	server_active(server);
	(void)sd_event_source_set_time(source, now_us + TICK_US);
	return 0;
}

/* ---- clients ---- */

static void call_open(void *arg, struct session *session, uint32_t slot, uint32_t ticket, int fd,
		      const char *path)
{
	server_open(arg, session, slot, ticket, fd, path);
}

static int call_answer(void *arg, struct session *session, const struct wire_header *question,
		       char **ret_text, struct why *why)
{
	struct server *server = arg;

	if (question->type == WIRE_ADMIN)
		return server_admin(server, session, (const struct wire_admin *)question, ret_text,
				    why);
	if (((const struct wire_status *)question)->what == WIRE_STATUS_METRICS)
		*ret_text = server_metrics(server);
	else
		*ret_text = server_status(server, session);
	return *ret_text ? 0 : why_errno(why, -ENOMEM, "the answer");
}

static void call_active(void *arg)
{
	server_active(arg);
}

static void end_session(struct session *session)
{
	struct account *account = session->account;

	session_destroy(session);
	account_leave(account);
}

static enum session_end end_of(const struct session *session)
{
	switch (-connection_error(session->connection)) {
	case 0:
		return SESSION_END_HUNG_UP;
	case ETIMEDOUT:
		return SESSION_END_SILENT;
	case EAGAIN:
		return SESSION_END_UNREAD;
	case ECANCELED:
		return SESSION_END_LEASE;
	case EPROTO:
	case EMSGSIZE:
	case E2BIG:
	case EPROTONOSUPPORT:
		return SESSION_END_PROTOCOL;
	default:
		return SESSION_END_OTHER;
	}
}

static void call_gone(void *arg, struct session *session)
{
	struct server *server = arg;

	server->session_ends[end_of(session)]++;
	end_session(session);
	server->session_count--;
	/* What it held may be what others wait for. */
	server_active(server);
}

static const struct session_calls session_calls = {
	.open = call_open,
	.answer = call_answer,
	.active = call_active,
	.gone = call_gone,
};

/* Told in one line, and closed. */
static void refuse_client(int fd, const struct why *why)
{
	struct wire_error message = { .error = -EAGAIN, .version = WIRE_VERSION };

	(void)snprintf(message.text, sizeof(message.text), "%s", why->text);
	wire_header_init(&message.header, WIRE_ERROR, sizeof(message));
	(void)wire_send(fd, &message, sizeof(message), NULL, 0);
	(void)fd_close(fd);
}

/* The account of who is at the other end, or a reason why there may be no session. */
static int join_account(struct server *server, int fd, struct account **ret, struct why *why)
{
	struct ucred peer;
	socklen_t length = sizeof(peer);
	struct account *account = NULL;
	uint64_t unlogged_count;
	int r;

	if (getsockopt(fd, SOL_SOCKET, SO_PEERCRED, &peer, &length) < 0)
		return why_errno(why, -errno, "a client's user");
	if (server->session_count == SESSION_COUNT_MAX)
		return why_set(why, -EAGAIN, "%u clients are connected already: close one",
			       SESSION_COUNT_MAX);
	r = accounts_join(&server->accounts, peer.uid, &account, why);
	if (r == -EAGAIN && account_may_log(account, clock_now_ns(), &unlogged_count))
		log_warning("a client (pid %d) is refused: %s", (int)peer.pid, why->text);
	if (r == 0)
		*ret = account;
	return r;
}

/* Returns: false when it was turned away. */
static bool add_client(struct server *server, int fd)
{
	struct session_config config = {
		.calls = &session_calls,
		.calls_arg = server,
		.room = &server->room,
		.queues = &server->queues,
		.fills = server->fills,
		.event = server->event,
		.number = server->next_number,
		.epoch = server->epoch,
		.lease_ns = (server->config.lease_ms ? server->config.lease_ms : LEASE_MS_USUAL) *
			    NS_PER_MS,
	};
	struct session *session;
	struct why why;

	if (join_account(server, fd, &config.account, &why) < 0) {
		refuse_client(fd, &why);
		server->refused_count++;
		return false;
	}
	if (session_create(&config, fd, &session, &why) < 0) {
		log_warning("a client cannot be served: %s", why.text);
		account_leave(config.account);
		return false;
	}
	if (++server->next_number == 0)
		server->next_number = 1;
	list_push_back(&server->sessions, &session->link);
	server->session_count++;
	server->accepted_count++;
	server->idle_since_ns = 0;
	return true;
}

/* Some a round, so that a storm of connections starves neither those connected nor those behind it. */
static int on_listen(sd_event_source *source, int listen_fd, uint32_t events, void *arg)
{
	struct server *server = arg;

	(void)events;
	for (uint32_t i = 0; i < ACCEPT_COUNT_MAX; i++) {
		int fd = accept4(listen_fd, NULL, NULL, SOCK_CLOEXEC | SOCK_NONBLOCK);

		if (fd >= 0) {
			if (add_client(server, fd))
				continue;
			server->listen_at_ns = clock_now_ns() + REFUSAL_PAUSE_US * NS_PER_US;
			(void)sd_event_source_set_enabled(source, SD_EVENT_OFF);
			server_active(server);
			break;
		}
		/* The socket stays readable: without this the loop would spin. */
		if (errno == EMFILE || errno == ENFILE || errno == ENOMEM || errno == ENOBUFS) {
			server->accept_error = -errno;
			log_warning("a client cannot be accepted: %s", strerror(errno));
			(void)sd_event_source_set_enabled(source, SD_EVENT_OFF);
		}
		break;
	}
	return 0;
}

/* ---- what has come back ---- */

/*
 * Reads that have ended and payloads that were judged, whichever of the two woke us: under load there
 * are always both, and each wake-up costs.  The next reads go out first, so that the disk does not wait
 * for the verification.
 */
static int on_reads(sd_event_source *source, int fd, uint32_t events, void *arg)
{
	struct server *server = arg;

	(void)source;
	(void)fd;
	(void)events;
	fetch_dispatch(server->fetch);
	if (!server->stopping)
		queues_pump(&server->queues);
	fetch_flush(server->fetch);
	fills_verify(server->fills);
	workers_dispatch(server->workers);
	server_active(server);
	return 0;
}

static void on_fill_ended(void *arg, const struct fill_result *result)
{
	struct server *server = arg;

	takeover_fill_ended(server->takeover, result);
	residents_fill_ended(&server->residents, result);
	LIST_FOR_EACH (link, &server->sessions)
		session_fill_ended(LIST_ENTRY(link, struct session, link), result);
}

/* SIGHUP.  Without a configuration to read it means what it always did: the terminal is gone. */
static int on_reload(sd_event_source *source, const struct signalfd_siginfo *info, void *arg)
{
	struct server *server = arg;
	struct why why;

	(void)source;
	(void)info;
	if (!server->config.reload) {
		stop(server);
		return 0;
	}
	(void)sd_notifyf(0, "RELOADING=1\nMONOTONIC_USEC=%llu",
			 (unsigned long long)(clock_now_ns() / NS_PER_US));
	if (server_reload(server, &why) < 0)
		log_error("reload: %s; all is as it was", why.text);
	else
		log_info("reloaded");
	(void)sd_notify(0, "READY=1");
	return 0;
}

/* ---- what a predecessor left ---- */

static const struct takeover_calls takeover_calls = {
	.ended = on_fill_ended,
	.active = call_active,
};

static int on_signal(sd_event_source *source, const struct signalfd_siginfo *info, void *arg)
{
	(void)source;
	(void)info;
	stop(arg);
	return 0;
}

/* ---- life ---- */

static int create_parts(struct server *server, struct why *why)
{
	const struct server_config *config = &server->config;
	const struct cache_calls cache_calls = {
		.make = server_make_segment,
		.gone = server_segment_gone,
	};
	struct fetch_config fetch_config = {
		.kind = config->fetch_kind,
		.depth = config->queue_depth,
		.done = fills_read_done,
		.sim = config->sim,
		.disk = config->disk,
	};
	int r;

	cache_init(&server->cache, config->cache_bytes, &cache_calls, server);
	room_init(&server->room, &server->cache);
	if (config->trace_path) {
		r = recorder_create(config->trace_path, config->cache_bytes,
				    replacement_name(config->replacement), &server->cache.recorder,
				    why);
		if (r < 0)
			return r;
	}
	r = workers_create(config->worker_count, &server->workers, why);
	if (r < 0)
		return r;
	r = fills_create(&server->cache, server->workers, on_fill_ended, server, &server->fills,
			 why);
	if (r < 0)
		return r;
	fetch_config.done_arg = server->fills;
	r = fetch_create(&fetch_config, &server->fetch, why);
	if (r < 0)
		return r;
	if (fetch_degraded(server->fetch)[0] != '\0')
		log_warning("%s; reading with threads instead", fetch_degraded(server->fetch));
	fills_set_fetch(server->fills, server->fetch);
	queues_init(&server->queues, server->fills);
	residents_init(&server->residents, &server->cache, &server->queues);
	r = takeover_create(&server->cache, server->fills, server->workers, &takeover_calls, server,
			    &server->takeover, why);
	if (r < 0)
		return r;
	fills_set_takeover(server->fills, takeover_want, server->takeover);
	return 0;
}

static int add_sources(struct server *server)
{
	sd_event *event = server->event;
	uint64_t now_us;
	sigset_t signals;
	int r;

	(void)sigemptyset(&signals);
	(void)sigaddset(&signals, SIGTERM);
	(void)sigaddset(&signals, SIGINT);
	(void)sigaddset(&signals, SIGHUP);
	if (sigprocmask(SIG_BLOCK, &signals, NULL) < 0)
		return -errno;
	r = sd_event_add_signal(event, NULL, SIGTERM, on_signal, server);
	if (r >= 0)
		r = sd_event_add_signal(event, NULL, SIGINT, on_signal, server);
	if (r >= 0)
		r = sd_event_add_signal(event, NULL, SIGHUP, on_reload, server);
	if (r >= 0)
		r = sd_event_add_defer(event, &server->round_source, on_round, server);
	if (r >= 0)
		r = sd_event_add_io(event, &server->listen_source, server->listener.fd, EPOLLIN,
				    on_listen, server);
	if (r >= 0)
		r = sd_event_add_io(event, &server->fetch_source, fetch_fd(server->fetch), EPOLLIN,
				    on_reads, server);
	if (r >= 0)
		r = sd_event_add_io(event, &server->workers_source, workers_fd(server->workers),
				    EPOLLIN, on_reads, server);
	if (r >= 0)
		r = sd_event_now(event, CLOCK_MONOTONIC, &now_us);
	if (r >= 0)
		r = sd_event_add_time(event, &server->wake_source, CLOCK_MONOTONIC, 0, 1, on_wake,
				      server);
	if (r >= 0)
		r = sd_event_add_time(event, &server->tick_source, CLOCK_MONOTONIC,
				      now_us + TICK_US, TICK_ACCURACY_US, on_tick, server);
	if (r >= 0)
		r = sd_event_source_set_enabled(server->tick_source, SD_EVENT_ON);
	return r < 0 ? r : 0;
}

/* Not zero, and another one at each start: clients tell a restarted daemon by it. */
static uint64_t make_epoch(void)
{
	struct timespec now;

	(void)clock_gettime(CLOCK_REALTIME, &now);
	return (uint64_t)now.tv_sec * NS_PER_S + (uint64_t)now.tv_nsec;
}

int server_create(const struct server_config *config, struct server **ret, struct why *why)
{
	struct server *server = calloc(1, sizeof(*server));
	int r;

	if (!server) {
		(void)fd_close(config->socket_fd);
		return why_errno(why, -ENOMEM, "the server");
	}
	server->config = *config;
	server->listener = LISTENER_NONE;
	server->metrics.listener = LISTENER_NONE;
	server->epoch = make_epoch();
	server->start_ns = clock_now_ns();
	notify_init(&server->notify, server->start_ns);
	server->next_number = 1;
	accounts_init(&server->accounts, config->policies, config->policy_count);
	list_init(&server->sessions);
	list_init(&server->cache.stores);
	r = config->socket_path
		    ? listener_open(config->socket_path, SOCK_SEQPACKET, &server->listener, why)
		    : listener_adopt(config->socket_fd, &server->listener, why);
	if (r < 0)
		goto err_destroy;
	r = sd_event_new(&server->event);
	if (r < 0) {
		(void)why_errno(why, r, "the event loop");
		goto err_destroy;
	}
	r = create_parts(server, why);
	if (r < 0)
		goto err_destroy;
	r = add_sources(server);
	if (r < 0) {
		(void)why_errno(why, r, "the event loop");
		goto err_destroy;
	}
	r = server_metrics_start(server, why);
	if (r < 0)
		goto err_destroy;
	server_take_over(server);
	server_active(server);
	*ret = server;
	return 0;

err_destroy:
	server_destroy(server);
	return r;
}

int server_run(struct server *server)
{
	return sd_event_loop(server->event);
}

/* Kernel and workers write to what is given back next: what they have begun is waited for. */
static void drain(struct server *server)
{
	if (!server->fetch)
		return;
	server->stopping = true;
	while (fills_count(server->fills) > 0 || workers_job_count(server->workers) > 0) {
		struct pollfd fds[] = {
			{ .fd = fetch_fd(server->fetch), .events = POLLIN },
			{ .fd = workers_fd(server->workers), .events = POLLIN },
		};

		if (poll(fds, ARRAY_LENGTH(fds), -1) < 0)
			continue;
		if (fds[0].revents)
			fetch_dispatch(server->fetch);
		fetch_flush(server->fetch);
		fills_verify(server->fills);
		if (fds[1].revents)
			workers_dispatch(server->workers);
	}
}

struct server *server_destroy(struct server *server)
{
	if (!server)
		return NULL;
	drain(server);
	LIST_FOR_EACH (link, &server->sessions) {
		session_freeze(LIST_ENTRY(link, struct session, link));
		end_session(LIST_ENTRY(link, struct session, link));
	}
	accounts_done(&server->accounts);
	server_metrics_stop(server);
	residents_done(&server->residents);
	server->workers = workers_destroy(server->workers);
	server->fetch = fetch_destroy(server->fetch);
	server->fills = fills_destroy(server->fills);
	server_close_stores(server);
	server->takeover = takeover_destroy(server->takeover);
	server->cache.recorder = recorder_destroy(server->cache.recorder);
	(void)sd_event_source_disable_unref(server->listen_source);
	(void)sd_event_source_disable_unref(server->fetch_source);
	(void)sd_event_source_disable_unref(server->workers_source);
	(void)sd_event_source_disable_unref(server->round_source);
	(void)sd_event_source_disable_unref(server->wake_source);
	(void)sd_event_source_disable_unref(server->tick_source);
	(void)sd_event_unref(server->event);
	listener_close(&server->listener);
	free(server);
	return NULL;
}
