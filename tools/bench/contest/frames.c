/* SPDX-License-Identifier: MIT */
#include "tools/bench/contest/frames.h"

#include <errno.h>
#include <math.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/ptrace.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "formats/base/bytes.h"
#include "formats/base/clock.h"
#include "formats/base/file.h"
#include "libclient/ooc/client.h"
#include "libclient/wire.h"
#include "tools/bench/base/measure.h"

#define WAIT_MS 120000
/** Frames of one share before it is the next one's turn. */
#define TURN_FRAMES 50u
/** Frames whose system calls are counted. */
#define COUNTED_FRAMES 20u

const unsigned frames_shares[FRAMES_SHARE_COUNT] = { 0, 10, 100 };

/* A client and the nodes that its sets are made of: those at [begin, begin + held_count) of a ring. */
struct holder {
	struct ooc_client *client;
	struct ooc_store *store;
	uint32_t *ring;
	size_t ring_count;
	size_t begin;
	size_t held_count;
	struct ooc_want *wants;
};

static void holder_done(struct holder *holder)
{
	holder->client = ooc_disconnect(holder->client);
	free(holder->ring);
	free(holder->wants);
	holder->ring = NULL;
	holder->wants = NULL;
}

static int holder_failed(const struct holder *holder, int error, struct why *why)
{
	return why_set(why, error, "%s", ooc_error_text(holder->client));
}

static void holder_want(struct holder *holder)
{
	for (size_t i = 0; i < holder->held_count; i++)
		holder->wants[i] = (struct ooc_want){
			.store = holder->store,
			.node = holder->ring[(holder->begin + i) % holder->ring_count],
			.importance = (float)(holder->held_count - i),
		};
}

/* The whole ring is in the cache afterwards, and the first set is held. */
static int holder_warm(struct holder *holder, struct why *why)
{
	for (int i = 0; i < 3; i++) {
		int64_t serial;
		int r;

		holder_want(holder);
		serial = ooc_visible_set(holder->client, holder->wants, holder->held_count);
		r = serial < 0 ? (int)serial : ooc_wait(holder->client, WAIT_MS);
		if (r < 0)
			return holder_failed(holder, r, why);
		holder->begin = (holder->begin + holder->held_count) % holder->ring_count;
	}
	return 0;
}

static int holder_init(struct holder *holder, const struct frames_config *config, struct why *why)
{
	const struct store_node *nodes;
	uint64_t node_count;
	int r = ooc_connect(config->socket_path, "oocbench", &holder->client);

	if (r < 0)
		return why_set(why, r, "%s", ooc_error_text(NULL));
	r = ooc_open(holder->client, config->store, &holder->store);
	if (r < 0)
		return why_set(why, r, "%s: %s", config->store, ooc_error_text(holder->client));
	nodes = ooc_nodes(holder->store);
	node_count = ooc_node_count(holder->store);
	holder->ring = calloc(2 * config->held_count + 1, sizeof(*holder->ring));
	holder->wants = calloc(config->held_count + 1, sizeof(*holder->wants));
	if (!holder->ring || !holder->wants)
		return why_set(why, -ENOMEM, "out of memory");
	for (uint32_t n = 0; n < node_count && holder->ring_count < 2 * config->held_count; n++)
		if (nodes[n].payload_id != 0)
			holder->ring[holder->ring_count++] = n;
	holder->held_count = holder->ring_count / 2;
	if (holder->held_count == 0)
		return why_set(why, -ENODATA, "%s: too few nodes", config->store);
	return holder_warm(holder, why);
}

/* The calls that a frame makes where nobody waits. */
static int holder_frame(struct holder *holder)
{
	int r = ooc_dispatch(holder->client);

	if (r < 0)
		return r;
	r = (int)ooc_visible_set(holder->client, holder->wants, holder->held_count);
	return r < 0 ? r : 0;
}

static void holder_turn(struct holder *holder, unsigned share_percent)
{
	size_t step = (holder->held_count * share_percent + 99) / 100;

	holder->begin = (holder->begin + step) % holder->ring_count;
	holder_want(holder);
}

static void holder_map(const struct holder *holder)
{
	for (size_t i = 0; i < holder->held_count; i++)
		(void)ooc_map(holder->store, holder->wants[i].node);
}

static void wait_until(uint64_t at_ns)
{
	struct timespec at = {
		.tv_sec = (time_t)(at_ns / NS_PER_S),
		.tv_nsec = (long)(at_ns % NS_PER_S),
	};

	while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &at, NULL) == EINTR &&
	       !measure_was_cancelled())
		;
}

/* ---- floors ---- */

/* What a frame cannot go below; see struct frames_cost. */
struct floor {
	struct ooc_want *wants; /* the holder's, copied */
	struct wire_set *message;
	size_t message_bytes;
	int fd; /* to a process that takes messages */
	pid_t pid;
};

static void floor_done(struct floor *floor)
{
	floor->fd = fd_close(floor->fd);
	while (floor->pid > 0 && waitpid(floor->pid, NULL, 0) < 0 && errno == EINTR)
		;
	free(floor->wants);
	free(floor->message);
}

static int floor_init(struct floor *floor, const struct holder *holder, struct why *why)
{
	size_t entry_count = u64_min(holder->held_count, WIRE_SET_ENTRY_COUNT_MAX);
	int fds[2];

	*floor = (struct floor){ .fd = -1 };
	floor->message_bytes = sizeof(struct wire_set) + entry_count * sizeof(struct wire_entry);
	floor->wants = calloc(holder->held_count + 1, sizeof(*floor->wants));
	floor->message = calloc(1, WIRE_MESSAGE_BYTES_MAX);
	if (!floor->wants || !floor->message)
		return why_set(why, -ENOMEM, "out of memory");
	if (socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, fds) < 0)
		return why_errno(why, -errno, "a socket");
	floor->pid = fork();
	if (floor->pid == 0) {
		(void)prctl(PR_SET_PDEATHSIG, SIGKILL);
		(void)fd_close(fds[0]);
		while (recv(fds[1], floor->message, WIRE_MESSAGE_BYTES_MAX, 0) > 0)
			;
		_exit(0);
	}
	(void)fd_close(fds[1]);
	floor->fd = fds[0];
	return floor->pid < 0 ? why_errno(why, -errno, "a process") : 0;
}

static double floor_measure(struct floor *floor, const struct holder *holder,
			    unsigned share_percent)
{
	size_t wants_bytes = holder->held_count * sizeof(*floor->wants);
	uint64_t begin_ns;

	if (share_percent > 0) {
		begin_ns = clock_now_ns();
		(void)wire_send(floor->fd, floor->message, floor->message_bytes, NULL, 0);
		return (double)(clock_now_ns() - begin_ns) / 1e3;
	}
	begin_ns = clock_now_ns();
	if (memcmp(floor->wants, holder->wants, wants_bytes) != 0)
		memcpy(floor->wants, holder->wants, wants_bytes);
	return (double)(clock_now_ns() - begin_ns) / 1e3;
}

/* One frame, measured; then what is left of its time is slept. */
static int frame_measure(struct holder *holder, unsigned share_percent, uint64_t end_ns,
			 double *ret_set_us, double *ret_map_us)
{
	uint64_t begin_ns;
	uint64_t set_ns;
	uint64_t map_ns;
	int r;

	holder_turn(holder, share_percent);
	begin_ns = clock_now_ns();
	r = holder_frame(holder);
	set_ns = clock_now_ns();
	holder_map(holder);
	map_ns = clock_now_ns();
	*ret_set_us = (double)(set_ns - begin_ns) / 1e3;
	*ret_map_us = (double)(map_ns - set_ns) / 1e3;
	wait_until(end_ns);
	return r;
}

static int cost_make(struct frames_cost *cost, size_t count)
{
	cost->count = count;
	cost->set_us = calloc(count, sizeof(double));
	cost->map_us = calloc(count, sizeof(double));
	cost->system_calls = NAN;
	return cost->set_us && cost->map_us ? 0 : -ENOMEM;
}

static void cost_done(struct frames_cost *cost)
{
	free(cost->set_us);
	free(cost->map_us);
	free(cost->floor_us);
	*cost = (struct frames_cost){ 0 };
}

/* ---- system calls ---- */

/* A call that nothing else makes, before and after what is counted. */
static void mark(void)
{
	(void)syscall(SYS_getpgid, 0);
}

/* The traced process. */
static void traced_frames(const struct frames_config *config, unsigned share_percent)
{
	struct holder holder = { 0 };
	struct why why;

	if (ptrace(PTRACE_TRACEME, 0, NULL, NULL) < 0 || raise(SIGSTOP) != 0 ||
	    holder_init(&holder, config, &why) < 0 || holder_frame(&holder) < 0)
		_exit(1);
	for (unsigned i = 0; i < COUNTED_FRAMES; i++) {
		int r;

		/* Time enough for the daemon's answer to the frame before, where there is one. */
		if (share_percent > 0)
			wait_until(clock_now_ns() + 20 * NS_PER_MS);
		holder_turn(&holder, share_percent);
		mark();
		r = holder_frame(&holder);
		mark();
		if (r < 0)
			_exit(1);
	}
	_exit(0);
}

/* Follows it to its end.  Returns: calls between two marks, or NaN. */
static double follow(pid_t pid)
{
	uintptr_t options = PTRACE_O_TRACESYSGOOD | PTRACE_O_EXITKILL;
	unsigned mark_count = 0;
	unsigned call_count = 0;
	int status;

	if (waitpid(pid, &status, 0) != pid || !WIFSTOPPED(status) ||
	    ptrace(PTRACE_SETOPTIONS, pid, NULL, options) < 0)
		return NAN;
	while (ptrace(PTRACE_SYSCALL, pid, NULL, NULL) == 0 && waitpid(pid, &status, 0) == pid &&
	       WIFSTOPPED(status)) {
		struct __ptrace_syscall_info info;

		if (WSTOPSIG(status) != (SIGTRAP | 0x80) ||
		    ptrace(PTRACE_GET_SYSCALL_INFO, pid, (uintptr_t)sizeof(info), &info) <= 0 ||
		    info.op != PTRACE_SYSCALL_INFO_ENTRY)
			continue;
		if (info.entry.nr == SYS_getpgid)
			mark_count++;
		else
			call_count += mark_count % 2;
	}
	return WIFEXITED(status) && mark_count == 2 * COUNTED_FRAMES
		       ? (double)call_count / COUNTED_FRAMES
		       : NAN;
}

static double count_system_calls(const struct frames_config *config, unsigned share_percent)
{
	pid_t pid = fork();
	double count;
	int status;

	if (pid == 0)
		traced_frames(config, share_percent);
	if (pid < 0)
		return NAN;
	count = follow(pid);
	/* It may have been left stopped; or it was waited for already. */
	if (kill(pid, SIGKILL) == 0)
		(void)waitpid(pid, &status, 0);
	return count;
}

/* ---- one client ---- */

/* Frames of one share, [first, end). */
static int turn_measure(const struct frames_config *config, struct holder *holder,
			struct floor *floor, unsigned share_percent, size_t first, size_t end,
			struct frames_cost *ret, struct why *why)
{
	uint64_t frame_ns = (uint64_t)((double)NS_PER_S / config->rate);
	uint64_t end_ns = clock_now_ns();

	for (size_t i = first; i < end; i++) {
		int r;

		end_ns += frame_ns;
		ret->floor_us[i] = floor_measure(floor, holder, share_percent);
		wait_until(end_ns - frame_ns / 2);
		r = frame_measure(holder, share_percent, end_ns, &ret->set_us[i], &ret->map_us[i]);
		if (r < 0)
			return holder_failed(holder, r, why);
		if (measure_was_cancelled())
			return why_set(why, -ECANCELED, "interrupted");
	}
	return 0;
}

int frames_measure_one(const struct frames_config *config, struct frames_one *ret, struct why *why)
{
	size_t count = config->frame_count;
	struct holder holder = { 0 };
	struct floor floor = { .fd = -1 };
	int r = holder_init(&holder, config, why);

	memset(ret, 0, sizeof(*ret));
	if (r == 0)
		r = floor_init(&floor, &holder, why);
	for (unsigned s = 0; r == 0 && s < FRAMES_SHARE_COUNT; s++) {
		ret->costs[s].floor_us = calloc(count, sizeof(double));
		if (!ret->costs[s].floor_us || cost_make(&ret->costs[s], count) < 0)
			r = why_set(why, -ENOMEM, "out of memory");
	}
	for (size_t first = 0; r == 0 && first < count; first += TURN_FRAMES)
		for (unsigned s = 0; r == 0 && s < FRAMES_SHARE_COUNT; s++)
			r = turn_measure(config, &holder, &floor, frames_shares[s], first,
					 u64_min(first + TURN_FRAMES, count), &ret->costs[s], why);
	ret->held_count = holder.held_count;
	holder_done(&holder);
	floor_done(&floor);
	for (unsigned s = 0; r == 0 && s < FRAMES_SHARE_COUNT; s++)
		ret->costs[s].system_calls = count_system_calls(config, frames_shares[s]);
	if (r < 0)
		frames_one_done(ret);
	return r;
}

void frames_one_done(struct frames_one *one)
{
	for (unsigned s = 0; s < FRAMES_SHARE_COUNT; s++)
		cost_done(&one->costs[s]);
}

/* ---- many clients ---- */

/* What the clients of a crowd write into, and where they wait for each other. */
struct crowd_shared {
	_Atomic unsigned ready_count;
	_Atomic bool begun;
	_Atomic bool failed;
	double answered[FRAMES_CLIENT_COUNT_MAX]; /* a second */
	double times_us[];                        /* client after client: sets, then maps */
};

/* Its own process. */
static void crowd_client(const struct frames_config *config, unsigned number,
			 unsigned share_percent, struct crowd_shared *shared)
{
	double *set_us = shared->times_us + 2 * number * config->frame_count;
	uint64_t frame_ns = (uint64_t)((double)NS_PER_S / config->rate);
	struct ooc_counters before;
	struct ooc_counters after;
	struct holder holder = { 0 };
	uint64_t begin_ns;
	struct why why;
	int r = holder_init(&holder, config, &why);

	if (r < 0)
		shared->failed = true;
	shared->ready_count++;
	while (!shared->begun)
		wait_until(clock_now_ns() + NS_PER_MS);
	if (r < 0)
		_exit(1);
	ooc_counters(holder.client, &before);
	begin_ns = clock_now_ns();
	for (size_t i = 0; r == 0 && i < config->frame_count; i++)
		r = frame_measure(&holder, share_percent, begin_ns + (i + 1) * frame_ns, &set_us[i],
				  &set_us[config->frame_count + i]);
	ooc_counters(holder.client, &after);
	if (r < 0)
		shared->failed = true;
	/* A set is sent when the one before was answered. */
	shared->answered[number] = (double)(after.sets_sent - before.sets_sent) /
				   ((double)(clock_now_ns() - begin_ns) / (double)NS_PER_S);
	holder_done(&holder);
	_exit(0);
}

static int crowd_take(const struct crowd_shared *shared, const struct frames_config *config,
		      unsigned client_count, struct frames_crowd *ret)
{
	if (cost_make(&ret->cost, client_count * config->frame_count) < 0)
		return -ENOMEM;
	ret->answered_low = HUGE_VAL;
	for (unsigned i = 0; i < client_count; i++) {
		const double *set_us = shared->times_us + 2 * i * config->frame_count;

		memcpy(ret->cost.set_us + i * config->frame_count, set_us,
		       config->frame_count * sizeof(double));
		memcpy(ret->cost.map_us + i * config->frame_count, set_us + config->frame_count,
		       config->frame_count * sizeof(double));
		ret->answered_low = fmin(ret->answered_low, shared->answered[i]);
		ret->answered_high = fmax(ret->answered_high, shared->answered[i]);
	}
	return 0;
}

int frames_measure_crowd(const struct frames_config *config, unsigned client_count,
			 unsigned share_percent, struct frames_crowd *ret, struct why *why)
{
	size_t bytes = sizeof(struct crowd_shared) +
		       2 * client_count * config->frame_count * sizeof(double);
	struct crowd_shared *shared =
		mmap(NULL, bytes, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
	pid_t pids[FRAMES_CLIENT_COUNT_MAX];
	unsigned begun_count = 0;
	int r = 0;

	memset(ret, 0, sizeof(*ret));
	if (shared == MAP_FAILED)
		return why_errno(why, -errno, "shared memory");
	for (; r == 0 && begun_count < client_count; begun_count++) {
		pids[begun_count] = fork();
		if (pids[begun_count] == 0) {
			(void)prctl(PR_SET_PDEATHSIG, SIGKILL);
			crowd_client(config, begun_count, share_percent, shared);
		}
		if (pids[begun_count] < 0) {
			r = why_errno(why, -errno, "a process");
			break;
		}
	}
	while (r == 0 && shared->ready_count < client_count && !measure_was_cancelled())
		wait_until(clock_now_ns() + NS_PER_MS);
	shared->begun = true;
	for (unsigned i = 0; i < begun_count; i++)
		(void)waitpid(pids[i], NULL, 0);
	if (r == 0 && measure_was_cancelled())
		r = why_set(why, -ECANCELED, "interrupted");
	if (r == 0 && shared->failed)
		r = why_set(why, -ECHILD, "a client of the crowd has failed");
	if (r == 0 && crowd_take(shared, config, client_count, ret) < 0)
		r = why_set(why, -ENOMEM, "out of memory");
	(void)munmap(shared, bytes);
	if (r < 0)
		frames_crowd_done(ret);
	return r;
}

void frames_crowd_done(struct frames_crowd *crowd)
{
	cost_done(&crowd->cost);
}
