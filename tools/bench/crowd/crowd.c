/* SPDX-License-Identifier: MIT */
#include "tools/bench/crowd/crowd.h"

#include <dirent.h>
#include <errno.h>
#include <inttypes.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "formats/base/bytes.h"
#include "formats/base/clock.h"
#include "formats/base/random.h"
#include "formats/store/store_checksum.h"
#include "formats/store/store_file.h"
#include "libclient/ooc/client.h"
#include "tools/bench/base/measure.h"
#include "tools/bench/crowd/crowd_client.h"
#include "tools/bench/crowd/crowd_hostile.h"

/* What the daemon may take to give back what the killed had, and how often that is asked. */
#define SETTLE_NS (10 * NS_PER_S)
#define POLL_NS   (10 * NS_PER_MS)
/* A life of the daemon is looked at from here on: before, it still takes what it needs. */
#define EARLY_NS (5 * NS_PER_S)

/* The daemon's own memory and descriptors, without those of segments, which come and go. */
struct footprint {
	uint64_t memory_bytes;
	uint64_t descriptors;
};

struct crowd {
	const struct crowd_config *config;
	struct crowd_result *result;
	struct crowd_shared *shared;
	char scratch[PATH_MAX];
	struct measure_daemon daemon;
	uint64_t cache_bytes;
	pid_t *clients;
	pid_t prober;
	struct hostiles *hostiles;
	struct random random;
	struct footprint before; /* nobody connected */
	/* Of the daemon's life now. */
	uint64_t life_begin_ns;
	struct footprint early;
	bool has_early;
	uint64_t longest_life_ns;
};

/* ---- what clients may want, and what it is ---- */

static int sum_node(const struct store_file *store, const struct store_node *record, uint64_t *ret,
		    struct why *why)
{
	void *payload = aligned_alloc(64, bytes_round_up(record->payload_bytes + 1, 64));
	void *stored = malloc(record->stored_bytes);
	int r = payload && stored ? store_read_payload(store, record, payload, stored, why)
				  : why_set(why, -ENOMEM, "out of memory");

	if (r == 0)
		*ret = store_checksum(payload, record->payload_bytes, record->payload_id);
	free(payload);
	free(stored);
	return r;
}

/* Every n-th node with a payload, so that all of the file is in it. */
static int choose_nodes(struct crowd *crowd, const struct store_file *store,
			const struct store_node *records, struct why *why)
{
	struct crowd_shared *shared = crowd->shared;
	uint64_t node_count = store_superblock(store)->node_count;
	uint64_t arena_bytes = 0;
	uint64_t payload_count = 0;
	uint64_t ordinal = 0;
	uint64_t stride;

	for (uint64_t i = 0; i < node_count; i++)
		payload_count += records[i].payload_id != 0;
	stride = payload_count / CROWD_NODES_MAX + 1;
	for (uint64_t i = 0; i < node_count; i++) {
		int r;

		if (records[i].payload_id == 0 || ordinal++ % stride > 0)
			continue;
		r = sum_node(store, &records[i], &shared->sums[shared->node_count], why);
		if (r < 0)
			return r;
		shared->nodes[shared->node_count++] = (uint32_t)i;
		arena_bytes += bytes_round_up(records[i].payload_bytes, 4096);
	}
	if (shared->node_count < 2)
		return why_set(why, -ENODATA, "it has too few nodes to choose from");
	crowd->cache_bytes = crowd->config->cache_bytes > 0 ? crowd->config->cache_bytes
							    : u64_max(arena_bytes / 4 * 3, MIB);
	return 0;
}

static int read_store(struct crowd *crowd, struct why *why)
{
	struct store_file *store;
	struct store_node *records;
	int r = store_open_path(crowd->config->store, &store, why);

	if (r < 0)
		return r;
	records = calloc(store_superblock(store)->node_count + 1, sizeof(*records));
	r = records ? store_load_hs(store, records, why) : why_set(why, -ENOMEM, "out of memory");
	if (r == 0)
		r = choose_nodes(crowd, store, records, why);
	if (r < 0)
		why_prefix(why, "%s", crowd->config->store);
	free(records);
	store_close(store);
	return r;
}

/* ---- the daemon ---- */

static int start_daemon(struct crowd *crowd, struct why *why)
{
	const struct crowd_config *config = crowd->config;
	char cache[32];
	char io[64];
	const char *options[] = { "--cache-size", cache, config->store, "--io", io, NULL };
	int r;

	(void)snprintf(cache, sizeof(cache), "%" PRIu64, crowd->cache_bytes);
	(void)snprintf(io, sizeof(io), "sim:seed=%" PRIu64 ",error=%" PRIu64, config->seed,
		       config->error_permille);
	if (config->error_permille == 0)
		options[3] = NULL;
	r = measure_daemon_start_with(crowd->scratch, options, &crowd->daemon, why);
	/* The hostile are another user, who has to get there. */
	if (r == 0 && config->hostile &&
	    (chmod(crowd->scratch, 0711) < 0 || chmod(crowd->daemon.socket_path, 0666) < 0))
		r = why_errno(why, -errno, "%s", crowd->daemon.socket_path);
	crowd->life_begin_ns = clock_now_ns();
	crowd->has_early = false;
	return r;
}

static uint64_t read_memory(pid_t pid)
{
	char path[64];
	char line[256];
	uint64_t kib = 0;
	FILE *file;

	(void)snprintf(path, sizeof(path), "/proc/%d/status", (int)pid);
	file = fopen(path, "re");
	while (file && fgets(line, sizeof(line), file))
		if (sscanf(line, "RssAnon: %" SCNu64, &kib) == 1)
			break;
	if (file)
		(void)fclose(file);
	return kib * KIB;
}

static uint64_t count_descriptors(pid_t pid)
{
	const struct dirent *entry;
	char path[64];
	uint64_t count = 0;
	DIR *folder;

	(void)snprintf(path, sizeof(path), "/proc/%d/fd", (int)pid);
	folder = opendir(path);
	while (folder && (entry = readdir(folder))) {
		char target[128];
		ssize_t length =
			readlinkat(dirfd(folder), entry->d_name, target, sizeof(target) - 1);

		target[length > 0 ? length : 0] = '\0';
		count += length > 0 && !strstr(target, "oocd-segment");
	}
	if (folder)
		(void)closedir(folder);
	return count;
}

static struct footprint footprint_of(const struct crowd *crowd)
{
	return (struct footprint){
		.memory_bytes = read_memory(crowd->daemon.child.pid),
		.descriptors = count_descriptors(crowd->daemon.child.pid),
	};
}

struct balance {
	double held_bytes;
	double sessions; /* this one included */
	double fills;
};

static int read_balance(struct crowd *crowd, struct balance *ret, struct why *why)
{
	struct ooc_client *client;
	char *status = NULL;
	int r = ooc_connect(crowd->daemon.socket_path, "oocbench", &client);

	if (r == 0)
		r = ooc_status(client, &status);
	if (r < 0)
		(void)why_set(why, r, "the daemon's status: %s", ooc_error_text(client));
	else if (measure_json_number(status, "held_and_busy_bytes", &ret->held_bytes) < 0 ||
		 measure_json_number(status, "sessions", &ret->sessions) < 0 ||
		 measure_json_number(status, "fills_in_flight", &ret->fills) < 0)
		r = why_set(why, -EPROTO, "the daemon's status lacks what is held");
	free(status);
	ooc_disconnect(client);
	return r;
}

/* Waits until nothing is held and nobody connected, or long enough. */
static int await_balance(struct crowd *crowd, struct balance *ret, struct why *why)
{
	uint64_t end_ns = clock_now_ns() + SETTLE_NS;
	int r;

	do {
		clock_pause_ns(POLL_NS);
		r = read_balance(crowd, ret, why);
	} while (r == 0 && clock_now_ns() < end_ns &&
		 (ret->held_bytes > 0 || ret->sessions > 1 || ret->fills > 0));
	/* The session that asked goes, too. */
	clock_pause_ns(10 * POLL_NS);
	return r;
}

/* ---- the crowd ---- */

static int start_client(struct crowd *crowd, uint64_t slot, struct why *why)
{
	crowd->clients[slot] = crowd_client_start(crowd->config, crowd->daemon.socket_path,
						  crowd->shared, random_next(&crowd->random));
	return crowd->clients[slot] < 0 ? why_errno(why, crowd->clients[slot], "a client") : 0;
}

static void kill_client(pid_t *pid)
{
	if (*pid <= 0)
		return;
	(void)kill(*pid, SIGKILL);
	while (waitpid(*pid, NULL, 0) < 0 && errno == EINTR) {
	}
	*pid = 0;
}

static void kill_all(struct crowd *crowd)
{
	for (uint64_t i = 0; crowd->clients && i < crowd->config->client_count; i++)
		kill_client(&crowd->clients[i]);
	kill_client(&crowd->prober);
	crowd->hostiles = hostiles_stop(crowd->hostiles);
}

static int start_all(struct crowd *crowd, struct why *why)
{
	int r = 0;

	crowd->prober = crowd_prober_start(crowd->config, crowd->daemon.socket_path, crowd->shared,
					   random_next(&crowd->random));
	if (crowd->prober < 0)
		return why_errno(why, crowd->prober, "the prober");
	for (uint64_t i = 0; r == 0 && i < crowd->config->client_count; i++)
		r = start_client(crowd, i, why);
	if (r == 0 && crowd->config->hostile)
		r = hostiles_start(crowd->config->store, crowd->daemon.socket_path,
				   random_next(&crowd->random), &crowd->hostiles, why);
	return r;
}

static int kill_one(struct crowd *crowd, struct why *why)
{
	uint64_t slot = random_next(&crowd->random) % crowd->config->client_count;

	kill_client(&crowd->clients[slot]);
	crowd->result->kills++;
	return start_client(crowd, slot, why);
}

/* What is early and late in the life of the daemon that ends, or goes on, now. */
static void look_at_life(struct crowd *crowd, uint64_t now_ns)
{
	struct crowd_result *result = crowd->result;
	struct footprint now = footprint_of(crowd);

	if (now_ns - crowd->life_begin_ns < EARLY_NS ||
	    atomic_load(&crowd->shared->connected) < crowd->config->client_count)
		return;
	if (!crowd->has_early)
		crowd->early = now;
	crowd->has_early = true;
	if (now_ns - crowd->life_begin_ns < crowd->longest_life_ns)
		return;
	crowd->longest_life_ns = now_ns - crowd->life_begin_ns;
	result->memory_early_bytes = crowd->early.memory_bytes;
	result->descriptors_early = crowd->early.descriptors;
	result->memory_late_bytes = now.memory_bytes;
	result->descriptors_late = now.descriptors;
}

static int kill_daemon(struct crowd *crowd, struct why *why)
{
	kill_client(&crowd->daemon.child.pid);
	measure_daemon_stop(&crowd->daemon);
	crowd->result->restarts++;
	return start_daemon(crowd, why);
}

/* Does it still run, and is it still to run? */
static int check_daemon(struct crowd *crowd, struct why *why)
{
	int status;

	/* Asked first: what interrupts us may have ended the daemon, too. */
	if (measure_was_cancelled())
		return why_set(why, -ECANCELED, "interrupted");
	if (waitpid(crowd->daemon.child.pid, &status, WNOHANG) != crowd->daemon.child.pid)
		return 0;
	crowd->daemon.child.pid = 0;
	return why_set(why, -ECHILD, "oocd has ended by %s %d; see its message above",
		       WIFSIGNALED(status) ? "signal" : "status",
		       WIFSIGNALED(status) ? WTERMSIG(status) : WEXITSTATUS(status));
}

static int run_for_a_time(struct crowd *crowd, struct why *why)
{
	const struct crowd_config *config = crowd->config;
	uint64_t now_ns = clock_now_ns();
	uint64_t end_ns = now_ns + config->seconds * NS_PER_S;
	uint64_t kill_ns = now_ns + config->kill_ms * NS_PER_MS;
	uint64_t restart_ns = now_ns + config->restart_s * NS_PER_S;
	uint64_t look_ns = now_ns;
	int r = 0;

	for (; r == 0 && now_ns < end_ns; now_ns = clock_now_ns()) {
		r = check_daemon(crowd, why);
		if (r == 0 && config->kill_ms > 0 && now_ns >= kill_ns) {
			r = kill_one(crowd, why);
			kill_ns += config->kill_ms * NS_PER_MS;
		}
		if (r == 0 && config->restart_s > 0 && now_ns >= restart_ns) {
			look_at_life(crowd, now_ns);
			r = kill_daemon(crowd, why);
			restart_ns += config->restart_s * NS_PER_S;
		}
		if (r == 0 && now_ns >= look_ns) {
			look_at_life(crowd, now_ns);
			look_ns = now_ns + NS_PER_S;
		}
		clock_pause_ns(POLL_NS / 2);
	}
	return r;
}

/* A first client fills the cache and goes: what the daemon has then is what it has to have. */
static int warm_up(struct crowd *crowd, struct why *why)
{
	uint64_t end_ns = clock_now_ns() + SETTLE_NS;
	struct balance balance;
	pid_t pid = crowd_client_start(crowd->config, crowd->daemon.socket_path, crowd->shared,
				       random_next(&crowd->random));
	int r = 0;

	if (pid < 0)
		return why_errno(why, pid, "a client");
	while (atomic_load(&crowd->shared->sets) < 10 && clock_now_ns() < end_ns && r == 0) {
		clock_pause_ns(POLL_NS);
		r = check_daemon(crowd, why);
	}
	kill_client(&pid);
	if (r == 0)
		r = await_balance(crowd, &balance, why);
	crowd->before = footprint_of(crowd);
	return r;
}

static void take_findings(struct crowd *crowd)
{
	struct crowd_result *result = crowd->result;
	struct crowd_shared *shared = crowd->shared;

	result->sets = shared->sets;
	result->reads = shared->reads;
	result->wrong = shared->wrong;
	result->stale = shared->stale;
	result->failed = shared->failed;
	result->refused_full = shared->refused_full;
	result->refused_unreadable = shared->refused_unreadable;
	result->lost = shared->lost;
	result->probes = atomic_load(&shared->probe_count);
	memcpy(result->first_failure, shared->first_failure, sizeof(result->first_failure));
	result->probe_ms = distribution_of(shared->probe_ms, result->probes);
	result->ping_ms = distribution_of(shared->ping_ms, atomic_load(&shared->ping_count));
}

static int run_in_scratch(struct crowd *crowd, struct why *why)
{
	struct balance balance = { 0 };
	struct footprint after;
	int r = start_daemon(crowd, why);

	if (r == 0)
		r = warm_up(crowd, why);
	if (r == 0)
		r = start_all(crowd, why);
	if (r == 0)
		r = run_for_a_time(crowd, why);
	kill_all(crowd);
	if (r == 0)
		r = await_balance(crowd, &balance, why);
	if (r == 0) {
		after = footprint_of(crowd);
		crowd->result->leaked_descriptors =
			(int64_t)after.descriptors - (int64_t)crowd->before.descriptors;
		crowd->result->leaked_holds_bytes = (uint64_t)balance.held_bytes;
		crowd->result->leaked_sessions = (uint64_t)balance.sessions - 1;
	}
	measure_daemon_stop(&crowd->daemon);
	take_findings(crowd);
	return r;
}

int crowd_run(const struct crowd_config *config, struct crowd_result *ret, struct why *why)
{
	struct crowd crowd = { .config = config, .result = ret, .random = { config->seed } };
	int r = measure_scratch_make(NULL, crowd.scratch, why);

	*ret = (struct crowd_result){ 0 };
	if (r < 0)
		return r;
	crowd.shared = mmap(NULL, sizeof(*crowd.shared), PROT_READ | PROT_WRITE,
			    MAP_SHARED | MAP_ANONYMOUS, -1, 0);
	crowd.clients = calloc(config->client_count, sizeof(*crowd.clients));
	if (crowd.shared == MAP_FAILED || !crowd.clients) {
		r = why_set(why, -ENOMEM, "out of memory");
	} else {
		r = read_store(&crowd, why);
		if (r == 0)
			r = run_in_scratch(&crowd, why);
	}
	if (crowd.shared != MAP_FAILED)
		(void)munmap(crowd.shared, sizeof(*crowd.shared));
	free(crowd.clients);
	measure_scratch_remove(crowd.scratch);
	return r;
}
