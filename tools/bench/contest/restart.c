/* SPDX-License-Identifier: MIT */
#include "tools/bench/contest/restart.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <limits.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "formats/base/bytes.h"
#include "formats/base/clock.h"
#include "formats/base/file.h"
#include "formats/store/store_checksum.h"
#include "formats/store/store_file.h"
#include "libclient/ooc/client.h"
#include "tools/bench/base/manager.h"
#include "tools/bench/base/measure.h"

#define STORES_MAX    32u
#define WARM_WAIT_MS  600000
#define FRAME_WAIT_MS 60000
#define VERIFY_NS     (120 * NS_PER_S)
#define POLL_NS       (5 * NS_PER_MS)
#define FRAME_NS      (NS_PER_S / 60)
/** What is summed to see how fast checksums are here: more than the processor's caches hold. */
#define SUMMED_BYTES (256 * MIB)

/** A node that is kept. */
struct kept {
	uint32_t store;
	uint32_t node;
};

/* What those who draw write into. */
struct shared {
	_Atomic bool is_over;
	_Atomic uint32_t ready_count;
	_Atomic uint64_t frame_count;
	_Atomic uint64_t incomplete_count;
};

struct restart {
	const struct restart_config *config;
	struct restart_result *result;
	char paths[STORES_MAX][PATH_MAX];
	uint32_t store_count;
	struct kept *kept;
	size_t kept_count;
	struct manager *manager;
	char program[PATH_MAX];
	char cache_bytes[32];
	struct shared *shared;
	pid_t clients[RESTART_CLIENTS_MAX];
};

/* A program that looks at all stores. */
struct looker {
	const struct restart *restart;
	struct ooc_client *client;
	struct ooc_store *stores[STORES_MAX];
	struct ooc_want *wants;
};

/* ---- lookers ---- */

static void looker_done(struct looker *looker)
{
	looker->client = ooc_disconnect(looker->client);
	free(looker->wants);
}

static int looker_failed(const struct looker *looker, int error, struct why *why)
{
	return why_set(why, error, "%s", ooc_error_text(looker->client));
}

static int looker_init(const struct restart *restart, size_t want_count, struct looker *ret,
		       struct why *why)
{
	int r;

	*ret = (struct looker){ .restart = restart };
	ret->wants = calloc(want_count + 1, sizeof(*ret->wants));
	if (!ret->wants)
		return why_set(why, -ENOMEM, "out of memory");
	r = ooc_connect(manager_socket(restart->manager), "oocbench", &ret->client);
	for (uint32_t i = 0; r == 0 && i < restart->store_count; i++)
		r = ooc_open(ret->client, restart->paths[i], &ret->stores[i]);
	if (r < 0) {
		r = looker_failed(ret, r, why);
		looker_done(ret);
	}
	return r;
}

/* Wants some of what is kept, from one on, in a ring. */
static int looker_want(struct looker *looker, size_t from, size_t count)
{
	const struct restart *restart = looker->restart;
	int64_t serial;

	for (size_t i = 0; i < count; i++) {
		const struct kept *kept = &restart->kept[(from + i) % restart->kept_count];

		looker->wants[i] = (struct ooc_want){
			.store = looker->stores[kept->store],
			.node = kept->node,
			.importance = (float)(count - i),
		};
	}
	serial = ooc_visible_set(looker->client, looker->wants, count);
	return serial < 0 ? (int)serial : 0;
}

static size_t frame_node_count(const struct restart *restart)
{
	return u64_min(restart->config->held_count, restart->kept_count);
}

/* ---- what is kept ---- */

static int copy_store(struct restart *restart, struct why *why)
{
	char *path = restart->paths[restart->store_count];
	AUTO_FD from = open(restart->config->store, O_RDONLY | O_CLOEXEC);
	AUTO_FD to = -1;
	ssize_t n = 1;

	(void)snprintf(path, PATH_MAX, "%s/copy-%u.ooc", restart->config->scratch,
		       restart->store_count);
	to = open(path, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
	if (from < 0 || to < 0)
		return why_errno(why, -errno, "%s", from < 0 ? restart->config->store : path);
	while (n > 0 && !measure_was_cancelled())
		n = copy_file_range(from, NULL, to, NULL, SSIZE_MAX & ~(size_t)4095, 0);
	if (measure_was_cancelled())
		return why_set(why, -ECANCELED, "interrupted");
	return n < 0 ? why_errno(why, -errno, "%s", path) : 0;
}

/* Notes the nodes of one store more, as far as there is not enough yet. */
static int keep_store(struct restart *restart, const struct store_node *nodes, uint64_t node_count,
		      struct why *why)
{
	uint64_t keep_bytes = restart->config->keep_bytes;
	struct kept *kept = realloc(restart->kept, (restart->kept_count + (size_t)node_count) *
							   sizeof(*restart->kept));

	if (!kept)
		return why_set(why, -ENOMEM, "out of memory");
	restart->kept = kept;
	for (uint32_t i = 0; i < node_count; i++) {
		if (nodes[i].payload_id == 0)
			continue;
		if (keep_bytes > 0 && restart->result->kept_bytes >= keep_bytes)
			break;
		kept[restart->kept_count++] = (struct kept){ restart->store_count, i };
		restart->result->kept_bytes += nodes[i].payload_bytes;
	}
	restart->store_count++;
	return restart->kept_count > 0
		       ? 0
		       : why_set(why, -ENODATA, "%s: nothing in it", restart->config->store);
}

/* The store, and copies of it as long as there is not enough. */
static int choose_kept(struct restart *restart, struct why *why)
{
	const struct restart_config *config = restart->config;
	struct store_node *nodes = NULL;
	uint64_t node_count = 0;
	struct store_file *store;
	int r = store_open_path(config->store, &store, why);

	if (r < 0)
		return r;
	node_count = store_superblock(store)->node_count;
	nodes = calloc(node_count + 1, sizeof(*nodes));
	r = nodes ? store_load_hs(store, nodes, why) : why_set(why, -ENOMEM, "out of memory");
	store_close(store);
	if (r == 0 && !realpath(config->store, restart->paths[0]))
		r = why_errno(why, -errno, "%s", config->store);
	if (r == 0)
		r = keep_store(restart, nodes, node_count, why);
	while (r == 0 && restart->result->kept_bytes < config->keep_bytes) {
		if (restart->store_count == STORES_MAX)
			r = why_set(why, -E2BIG, "%s: too small to keep %" PRIu64 " MiB of copies",
				    config->store, config->keep_bytes / MIB);
		if (r == 0)
			r = copy_store(restart, why);
		if (r == 0)
			r = keep_store(restart, nodes, node_count, why);
	}
	restart->result->store_count = restart->store_count;
	restart->result->kept_count = restart->kept_count;
	/* Payloads begin on pages, and segments are of one store. */
	(void)snprintf(
		restart->cache_bytes, sizeof(restart->cache_bytes), "%" PRIu64,
		bytes_round_up(restart->result->kept_bytes + restart->kept_count * 4096, 64 * MIB) +
			restart->store_count * 128 * MIB);
	free(nodes);
	return r;
}

/* Brings all of it in, and lets go of it. */
static int warm_up(struct restart *restart, struct why *why)
{
	struct looker looker;
	int r = looker_init(restart, restart->kept_count, &looker, why);

	if (r < 0)
		return r;
	r = looker_want(&looker, 0, restart->kept_count);
	if (r == 0)
		r = ooc_wait(looker.client, WARM_WAIT_MS);
	if (r < 0)
		r = looker_failed(&looker, r, why);
	looker_done(&looker);
	return r;
}

/* ---- the load ---- */

/* Its own process: a tenth of the set is another one each frame. */
static _Noreturn void draw(const struct restart *restart, unsigned number)
{
	size_t count = frame_node_count(restart);
	size_t from = restart->kept_count / restart->config->client_count * number;
	struct ooc_progress progress;
	struct looker looker;
	struct why why;

	(void)prctl(PR_SET_PDEATHSIG, SIGKILL);
	if (looker_init(restart, count, &looker, &why) < 0)
		_exit(1);
	for (bool is_ready = false; !restart->shared->is_over; from += count / 10 + 1) {
		uint64_t end_ns = clock_now_ns() + FRAME_NS;
		uint64_t now_ns;

		(void)ooc_dispatch(looker.client);
		ooc_progress(looker.client, &progress);
		restart->shared->frame_count++;
		restart->shared->incomplete_count += !progress.complete;
		restart->shared->ready_count += !is_ready && progress.want_count > 0;
		is_ready = is_ready || progress.want_count > 0;
		(void)looker_want(&looker, from, count);
		now_ns = clock_now_ns();
		clock_pause_ns(now_ns < end_ns ? end_ns - now_ns : 0);
	}
	_exit(0);
}

static int clients_start(struct restart *restart, struct why *why)
{
	unsigned count = restart->config->client_count;

	for (unsigned i = 0; i < count; i++) {
		restart->clients[i] = fork();
		if (restart->clients[i] == 0)
			draw(restart, i);
		if (restart->clients[i] < 0)
			return why_errno(why, -errno, "a process");
	}
	while (restart->shared->ready_count < count) {
		clock_pause_ns(POLL_NS);
		if (measure_was_cancelled())
			return why_set(why, -ECANCELED, "interrupted");
		for (unsigned i = 0; i < count; i++)
			if (waitpid(restart->clients[i], NULL, WNOHANG) == restart->clients[i]) {
				restart->clients[i] = 0;
				return why_set(why, -ECHILD, "a program that draws has failed");
			}
	}
	return 0;
}

static void clients_stop(struct restart *restart)
{
	restart->shared->is_over = true;
	for (unsigned i = 0; i < restart->config->client_count; i++)
		while (restart->clients[i] > 0 && waitpid(restart->clients[i], NULL, 0) < 0 &&
		       errno == EINTR)
			;
}

/* ---- a restart ---- */

static int start_daemon(struct restart *restart, struct why *why)
{
	const char *options[] = { "--cache-size", restart->cache_bytes, NULL };

	return manager_start(restart->manager, restart->program, options, why);
}

static double seconds_since(uint64_t begin_ns)
{
	return (double)(clock_now_ns() - begin_ns) / (double)NS_PER_S;
}

/* A program that starts now, until its first frame is whole. */
static int first_frame(const struct restart *restart, struct looker *ret, struct why *why)
{
	size_t count = frame_node_count(restart);
	struct ooc_progress progress;
	int r = looker_init(restart, count, ret, why);

	if (r < 0)
		return r;
	r = looker_want(ret, 0, count);
	if (r == 0)
		r = ooc_wait(ret->client, FRAME_WAIT_MS);
	if (r < 0)
		r = looker_failed(ret, r, why);
	ooc_progress(ret->client, &progress);
	if (r == 0 && !progress.complete)
		r = why_set(why, -ENOBUFS, "%zu of %zu nodes were answered \"not now\"",
			    progress.refused_count, progress.want_count);
	if (r < 0)
		looker_done(ret);
	return r;
}

/* Waits until all that was kept was looked at. */
static int await_verified(struct restart *restart, struct looker *looker, struct why *why)
{
	uint64_t end_ns = clock_now_ns() + VERIFY_NS;

	for (;;) {
		double verified = 0;
		double reread = 0;
		double left = 0;
		char *text = NULL;
		int r = ooc_status(looker->client, &text);

		if (r < 0)
			return looker_failed(looker, r, why);
		if (measure_json_number(text, "takeover_verified", &verified) < 0 ||
		    measure_json_number(text, "takeover_reread", &reread) < 0 ||
		    measure_json_number(text, "takeover_left", &left) < 0)
			r = why_set(why, -EPROTO, "the daemon's status lacks what was taken over");
		free(text);
		if (r < 0)
			return r;
		if (left == 0 && verified + reread >= (double)restart->kept_count) {
			restart->result->reread_count += (uint64_t)reread;
			return 0;
		}
		if (measure_was_cancelled())
			return why_set(why, -ECANCELED, "interrupted");
		if (clock_now_ns() > end_ns)
			return why_set(why, -ETIMEDOUT, "of %zu payloads kept %.0f were verified",
				       restart->kept_count, verified);
		clock_pause_ns(POLL_NS);
	}
}

static int run_round(struct restart *restart, struct why *why)
{
	struct restart_result *result = restart->result;
	struct shared *shared = restart->shared;
	size_t round = result->round_count;
	uint64_t frame_count = shared->frame_count;
	uint64_t incomplete_count = shared->incomplete_count;
	uint64_t begin_ns = clock_now_ns();
	struct looker looker;
	int r;

	(void)manager_stop(restart->manager, SIGKILL);
	result->gone_s[round] = seconds_since(begin_ns);
	r = start_daemon(restart, why);
	result->ready_s[round] = seconds_since(begin_ns);
	if (r == 0)
		r = first_frame(restart, &looker, why);
	if (r < 0)
		return r;
	result->first_frame_s[round] = seconds_since(begin_ns);
	r = await_verified(restart, &looker, why);
	looker_done(&looker);
	result->verified_s[round] = seconds_since(begin_ns);
	result->frame_count += shared->frame_count - frame_count;
	result->incomplete_count += shared->incomplete_count - incomplete_count;
	result->round_count += r == 0;
	return r;
}

static int run_rounds(struct restart *restart, struct why *why)
{
	int r = start_daemon(restart, why);

	if (r == 0)
		r = warm_up(restart, why);
	if (r == 0)
		r = clients_start(restart, why);
	while (r == 0 && restart->result->round_count < restart->config->repeat_count)
		r = run_round(restart, why);
	clients_stop(restart);
	return r;
}

static int measure_checksum(struct restart_result *result, struct why *why)
{
	uint64_t bytes = u64_min(result->kept_bytes, SUMMED_BYTES);
	uint8_t *data = malloc(bytes);
	uint64_t begin_ns;
	uint64_t sum;

	if (!data)
		return why_set(why, -ENOMEM, "out of memory");
	memset(data, 1, bytes);
	begin_ns = clock_now_ns();
	sum = store_checksum(data, bytes, 1);
	result->checksum_s = seconds_since(begin_ns) * (double)result->kept_bytes / (double)bytes;
	free(data);
	/* So that it is made at all. */
	return sum == 0 ? why_set(why, -EBADMSG, "a checksum of nothing") : 0;
}

int restart_measure(const struct restart_config *config, struct restart_result *ret,
		    struct why *why)
{
	struct restart *restart = calloc(1, sizeof(*restart));
	int r;

	*ret = (struct restart_result){ 0 };
	if (!restart)
		return why_set(why, -ENOMEM, "out of memory");
	restart->config = config;
	restart->result = ret;
	measure_program("oocd", restart->program);
	restart->shared = mmap(NULL, sizeof(*restart->shared), PROT_READ | PROT_WRITE,
			       MAP_SHARED | MAP_ANONYMOUS, -1, 0);
	r = restart->shared == MAP_FAILED ? why_errno(why, -errno, "shared memory")
					  : choose_kept(restart, why);
	if (r == 0)
		r = manager_create(config->scratch, &restart->manager, why);
	if (r == 0)
		r = run_rounds(restart, why);
	restart->manager = manager_destroy(restart->manager);
	if (r == 0)
		r = measure_checksum(ret, why);
	if (restart->shared != MAP_FAILED)
		(void)munmap(restart->shared, sizeof(*restart->shared));
	free(restart->kept);
	free(restart);
	return r;
}

void restart_report(struct restart_result *result, struct report *report)
{
	size_t count = result->round_count;

	report_number(report, "kept_stores", "stores", (double)result->store_count, "");
	report_number(report, "kept_nodes", "payloads kept", (double)result->kept_count, "");
	report_number(report, "kept_bytes", "bytes of them", (double)result->kept_bytes, "bytes");
	report_spread(report, "gone_s", "from the kill until the killed daemon is gone",
		      spread_of(result->gone_s, count), "s");
	report_spread(report, "ready_s", "until the next is ready",
		      spread_of(result->ready_s, count), "s");
	report_spread(report, "first_frame_s", "until a program that starts then has a whole frame",
		      spread_of(result->first_frame_s, count), "s");
	report_spread(report, "verified_s", "until all that was kept is verified",
		      spread_of(result->verified_s, count), "s");
	report_number(report, "checksum_s", "their checksums alone, one thread", result->checksum_s,
		      "s");
	report_number(report, "reread", "payloads that had to be read again",
		      (double)result->reread_count, "");
	report_number(report, "survivor_frames", "frames drawn by others meanwhile",
		      (double)result->frame_count, "");
	report_number(report, "survivor_incomplete", "of them without some node",
		      (double)result->incomplete_count, "");
}
