/* SPDX-License-Identifier: MIT */
#include "daemon/restart/takeover.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>

#include "daemon/cache/recorder.h"
#include "daemon/limits.h"
#include "formats/base/check.h"
#include "formats/base/clock.h"
#include "formats/base/file.h"
#include "formats/base/log.h"
#include "formats/store/store_checksum.h"

/* A job is that long at most, so that what is wanted overtakes within a fraction of a millisecond. */
#define CHECK_COUNT_MAX 16u
#define CHECK_BYTES_MAX (1u * MIB)
/* Two for each worker keep it busy while the loop takes the answers, and no more wait in its queue. */
#define CHECKS_A_WORKER 2u
#define CHECKS_MAX      (CHECKS_A_WORKER * WORKER_COUNT_MAX)

enum payload_state {
	PAYLOAD_NONE = 0, /* not inherited, or lost since */
	PAYLOAD_LEFT,     /* nobody waits for it in particular */
	PAYLOAD_WANTED,   /* on wanted[] */
	PAYLOAD_CHECKING, /* with a worker */
	PAYLOAD_WRONG,    /* to be read again; on wrong[] */
	PAYLOAD_READING,  /* with fills.c */
	PAYLOAD_DONE,
};

/* A store's inheritance.  Arrays of payload_count but for states and kept. */
struct inherited {
	struct list link; /* takeover.stores */
	struct takeover *takeover;
	struct served *served;
	uint64_t grace_end_ns;
	uint32_t payload_count;
	uint32_t left;
	uint32_t *order;    /* nodes by their place: neighbours are verified together */
	uint32_t held_next; /* in order: what was held is looked at first, */
	uint32_t rest_next; /* then the rest */
	uint32_t *wanted;
	uint32_t wanted_first;
	uint32_t wanted_end;
	uint32_t *wrong;
	uint32_t wrong_count;
	uint8_t *states; /* node_count: enum payload_state */
	bool *kept;      /* node_count: held for survivors */
	uint32_t directory_count;
	struct memfile directories[KEPT_DIRECTORY_MAX]; /* that survivors look at */
	uint64_t epochs[KEPT_DIRECTORY_MAX];
};

/* One job: payloads of a store. */
struct check {
	struct worker_job job;
	struct list link; /* takeover.unused */
	struct inherited *inherited;
	uint32_t count;
	struct {
		uint32_t index;
		uint32_t bytes;
		const uint8_t *payload;
		uint64_t payload_id;
		uint64_t checksum;
		bool right;
	} payloads[CHECK_COUNT_MAX];
};

struct takeover {
	struct cache *cache;
	struct fills *fills;
	struct workers *workers;
	struct takeover_calls calls;
	void *calls_arg;
	struct list stores; /* whose grace is not over */
	struct list unused;
	uint64_t start_ns;
	struct takeover_counts counts;
	struct check checks[CHECKS_MAX];
};

int takeover_create(struct cache *cache, struct fills *fills, struct workers *workers,
		    const struct takeover_calls *calls, void *calls_arg, struct takeover **ret,
		    struct why *why)
{
	struct takeover *takeover = calloc(1, sizeof(*takeover));

	if (!takeover)
		return why_errno(why, -ENOMEM, "taking over");
	takeover->cache = cache;
	takeover->fills = fills;
	takeover->workers = workers;
	takeover->calls = *calls;
	takeover->calls_arg = calls_arg;
	takeover->start_ns = clock_now_ns();
	list_init(&takeover->stores);
	list_init(&takeover->unused);
	for (uint32_t i = 0; i < CHECKS_A_WORKER * workers_count(workers); i++)
		list_push_back(&takeover->unused, &takeover->checks[i].link);
	*ret = takeover;
	return 0;
}

struct takeover *takeover_destroy(struct takeover *takeover)
{
	if (takeover)
		CHECK(list_is_empty(&takeover->stores));
	free(takeover);
	return NULL;
}

void takeover_forget(struct served *served)
{
	struct inherited *inherited = served->inherited;

	if (!inherited)
		return;
	list_remove(&inherited->link);
	for (uint32_t i = 0; i < inherited->directory_count; i++)
		memfile_done(&inherited->directories[i]);
	free(inherited->order);
	free(inherited->wanted);
	free(inherited->wrong);
	free(inherited->states);
	free(inherited->kept);
	free(inherited);
	served->inherited = NULL;
}

/* ---- begin: places ---- */

/* Where a predecessor had a node. */
struct was {
	struct place place;
	uint32_t index;
};

static int was_compare(const void *a, const void *b)
{
	const struct was *left = a;
	const struct was *right = b;

	if (left->place.segment != right->place.segment)
		return left->place.segment < right->place.segment ? -1 : 1;
	if (left->place.page != right->place.page)
		return left->place.page < right->place.page ? -1 : 1;
	return 0;
}

static uint32_t read_words(const struct served *served, const struct wire_directory *directory,
			   struct was *ret)
{
	uint32_t count = 0;

	for (uint32_t i = 0; i < served->node_count; i++) {
		uint64_t word = atomic_load_explicit(&directory->words[i], memory_order_relaxed);
		enum wire_node_state state = wire_word_state(word);

		if (!served_has_payload(served, i) ||
		    (state != WIRE_NODE_READY && state != WIRE_NODE_BUSY))
			continue;
		ret[count++] = (struct was){
			.place = { wire_word_segment(word), wire_word_page(word) },
			.index = i,
		};
	}
	return count;
}

/* What was held stays held, for those who may be drawing it. */
static void adopt_nodes(struct inherited *inherited, const struct was *was, uint32_t count)
{
	struct served *served = inherited->served;
	struct cache *cache = inherited->takeover->cache;

	for (uint32_t i = 0; i < count; i++) {
		uint32_t index = was[i].index;

		if (cache_adopt_node(cache, served, index, was[i].place) < 0)
			continue;
		recorder_node(served, TRACE_ADOPT, index);
		inherited->order[inherited->payload_count++] = index;
		inherited->states[index] = PAYLOAD_LEFT;
		if (!atomic_load_explicit(&served->ledger.held[index], memory_order_relaxed))
			continue;
		cache_hold(cache, served, index);
		inherited->kept[index] = true;
	}
	inherited->left = inherited->payload_count;
}

/* ---- begin: memory ---- */

/* The directories that survivors look at.  Those of clients whose grace is over say so: epoch 0. */
static void adopt_directories(struct inherited *inherited, struct kept_store *kept)
{
	const struct served *served = inherited->served;

	for (uint32_t i = 0; i < kept->directory_count; i++) {
		struct memfile *memfile = &inherited->directories[inherited->directory_count];
		const struct wire_directory *directory;
		int fd = kept->directories[i].fd;

		kept->directories[i].fd = -1;
		if (memfile_adopt(fd, memfile, NULL) == 0) {
			directory = memfile->base;
			if (memfile->bytes >=
				    sizeof(*directory) + served->node_count * sizeof(uint64_t) &&
			    directory->node_count == served->node_count &&
			    directory->generation == served->superblock->generation &&
			    atomic_load(&directory->epoch) != 0) {
				inherited->epochs[inherited->directory_count++] =
					kept->directories[i].epoch;
				continue;
			}
			memfile_done(memfile);
		}
		handover_forget_directory(served, kept->directories[i].epoch);
	}
}

/* What does not fit stays with kept, which closes it: who still draws from it keeps it alive. */
static void adopt_segments(struct takeover *takeover, struct served *served,
			   struct kept_store *kept)
{
	for (uint32_t i = 0; i < kept->segment_count; i++) {
		struct kept_segment *from = &kept->segments[i];
		struct memfile memfile;
		struct segment *segment;
		int fd = fcntl(from->fd, F_DUPFD_CLOEXEC, 3);

		if (fd < 0 || memfile_adopt(fd, &memfile, NULL) < 0)
			continue;
		memfile.huge_bytes = (uint64_t)from->huge_mib * MIB;
		if (memfile.bytes != served->arena.segment_bytes ||
		    memfile.huge_bytes > memfile.bytes ||
		    cache_adopt_segment(takeover->cache, served, &memfile, from->number, &segment) <
			    0) {
			memfile_done(&memfile);
			continue;
		}
		from->fd = fd_close(from->fd);
		segment->buffer = FETCH_BUFFER_NONE;
		segment->inherited = true;
	}
}

static int inherited_create(struct takeover *takeover, struct served *served,
			    struct inherited **ret)
{
	struct inherited *inherited = calloc(1, sizeof(*inherited));
	size_t count = served->node_count;

	if (!inherited)
		return -ENOMEM;
	list_init(&inherited->link);
	inherited->takeover = takeover;
	inherited->served = served;
	served->inherited = inherited;
	inherited->order = calloc(count, sizeof(*inherited->order));
	inherited->wanted = calloc(count, sizeof(*inherited->wanted));
	inherited->wrong = calloc(count, sizeof(*inherited->wrong));
	inherited->states = calloc(count, sizeof(*inherited->states));
	inherited->kept = calloc(count, sizeof(*inherited->kept));
	if (!inherited->order || !inherited->wanted || !inherited->wrong || !inherited->states ||
	    !inherited->kept) {
		takeover_forget(served);
		return -ENOMEM;
	}
	*ret = inherited;
	return 0;
}

int takeover_begin(struct takeover *takeover, struct served *served, struct kept_store *kept,
		   uint64_t grace_end_ns)
{
	struct was *was = calloc(served->node_count, sizeof(*was));
	struct inherited *inherited;
	uint32_t count;

	if (!was || inherited_create(takeover, served, &inherited) < 0) {
		free(was);
		return -ENOMEM;
	}
	list_push_back(&takeover->stores, &inherited->link);
	inherited->grace_end_ns = grace_end_ns;
	adopt_directories(inherited, kept);
	if (inherited->directory_count > 0) {
		adopt_segments(takeover, served, kept);
		count = read_words(served, inherited->directories[0].base, was);
		qsort(was, count, sizeof(*was), was_compare);
		adopt_nodes(inherited, was, count);
		takeover->counts.left += inherited->left;
	}
	free(was);
	return 0;
}

/* ---- verification ---- */

/* On a worker. */
static void check_run(struct worker_job *job, struct codec_scratch *scratch)
{
	struct check *check = LIST_ENTRY(job, struct check, job);

	(void)scratch;
	for (uint32_t i = 0; i < check->count; i++)
		check->payloads[i].right =
			store_checksum(check->payloads[i].payload, check->payloads[i].bytes,
				       check->payloads[i].payload_id) ==
			check->payloads[i].checksum;
}

static void payload_done(struct inherited *inherited, uint32_t index)
{
	struct takeover *takeover = inherited->takeover;

	inherited->states[index] = PAYLOAD_DONE;
	inherited->left--;
	takeover->counts.left--;
	if (takeover->counts.left == 0)
		log_info(
			"%llu payloads, %llu MiB, are taken over after %llu ms; %llu were read again",
			(unsigned long long)takeover->counts.verified,
			(unsigned long long)(takeover->counts.bytes / MIB),
			(unsigned long long)((clock_now_ns() - takeover->start_ns) / NS_PER_MS),
			(unsigned long long)takeover->counts.reread);
}

static void check_done(struct worker_job *job)
{
	struct check *check = LIST_ENTRY(job, struct check, job);
	struct inherited *inherited = check->inherited;
	struct takeover *takeover = inherited->takeover;

	list_push_back(&takeover->unused, &check->link);
	for (uint32_t i = 0; i < check->count; i++) {
		uint32_t index = check->payloads[i].index;
		const struct fill_result result = {
			.served = inherited->served,
			.index = index,
			.prefetch = true,
		};

		CHECK(inherited->states[index] == PAYLOAD_CHECKING);
		if (!check->payloads[i].right) {
			inherited->states[index] = PAYLOAD_WRONG;
			inherited->wrong[inherited->wrong_count++] = index;
			continue;
		}
		takeover->counts.verified++;
		takeover->counts.bytes += check->payloads[i].bytes;
		payload_done(inherited, index);
		cache_end_fill(takeover->cache, inherited->served, index);
		takeover->calls.ended(takeover->calls_arg, &result);
	}
	takeover->calls.active(takeover->calls_arg);
}

/* The next payload in the order of demand.  Returns: false when none is left to be verified. */
static bool next_payload(struct inherited *inherited, uint32_t *ret_index)
{
	while (inherited->wanted_first < inherited->wanted_end) {
		*ret_index = inherited->wanted[inherited->wanted_first++];
		if (inherited->states[*ret_index] == PAYLOAD_WANTED)
			return true;
	}
	while (inherited->held_next < inherited->payload_count) {
		*ret_index = inherited->order[inherited->held_next++];
		if (inherited->states[*ret_index] == PAYLOAD_LEFT && inherited->kept[*ret_index])
			return true;
	}
	while (inherited->rest_next < inherited->payload_count) {
		*ret_index = inherited->order[inherited->rest_next++];
		if (inherited->states[*ret_index] == PAYLOAD_LEFT)
			return true;
	}
	return false;
}

/* What a payload's bytes in the arena must be: of one without codec, what they are in the store. */
static uint64_t checksum_of(const struct served *served, uint32_t index)
{
	const struct store_node *record = &served->records[index];

	return record->codec == STORE_CODEC_NONE ? record->payload_checksum
						 : served->ledger.checksums[index];
}

static bool check_fill(struct check *check, struct inherited *inherited)
{
	const struct served *served = inherited->served;
	uint32_t bytes = 0;
	uint32_t index;

	check->inherited = inherited;
	check->count = 0;
	while (check->count < CHECK_COUNT_MAX && bytes < CHECK_BYTES_MAX &&
	       next_payload(inherited, &index)) {
		const struct store_node *record = &served->records[index];

		inherited->states[index] = PAYLOAD_CHECKING;
		check->payloads[check->count].index = index;
		check->payloads[check->count].bytes = record->payload_bytes;
		check->payloads[check->count].payload =
			arena_address(&served->arena, served->nodes[index].place);
		check->payloads[check->count].payload_id = record->payload_id;
		check->payloads[check->count].checksum = checksum_of(served, index);
		check->count++;
		bytes += record->payload_bytes;
	}
	return check->count > 0;
}

/* Where the fills have no room, later. */
static void read_again(struct inherited *inherited)
{
	struct takeover *takeover = inherited->takeover;

	while (inherited->wrong_count > 0) {
		uint32_t index = inherited->wrong[inherited->wrong_count - 1];

		if (fills_again(takeover->fills, inherited->served, index) < 0)
			return;
		inherited->wrong_count--;
		inherited->states[index] = PAYLOAD_READING;
		takeover->counts.reread++;
	}
}

void takeover_pump(struct takeover *takeover)
{
	LIST_FOR_EACH (link, &takeover->stores) {
		struct inherited *inherited = LIST_ENTRY(link, struct inherited, link);

		if (inherited->left == 0)
			continue;
		read_again(inherited);
		while (!list_is_empty(&takeover->unused)) {
			struct check *check = LIST_ENTRY(takeover->unused.next, struct check, link);

			if (!check_fill(check, inherited))
				break;
			list_remove(&check->link);
			check->job = (struct worker_job){ .run = check_run, .done = check_done };
			list_init(&check->job.link);
			workers_add(takeover->workers, &check->job);
		}
	}
}

void takeover_want(void *arg, const struct served *served, uint32_t index)
{
	struct inherited *inherited = served->inherited;
	struct takeover *takeover = arg;

	CHECK(inherited != NULL);
	if (inherited->states[index] != PAYLOAD_LEFT)
		return;
	inherited->states[index] = PAYLOAD_WANTED;
	inherited->wanted[inherited->wanted_end++] = index;
	takeover->calls.active(takeover->calls_arg);
}

void takeover_fill_ended(struct takeover *takeover, const struct fill_result *result)
{
	struct inherited *inherited = result->served->inherited;
	uint32_t index = result->index;

	if (!inherited || inherited->states[index] != PAYLOAD_READING)
		return;
	payload_done(inherited, index);
	if (result->reason == WIRE_REASON_NONE)
		return;
	/* It is about to go: what survivors draw of it is lost to them. */
	if (inherited->kept[index])
		cache_release(takeover->cache, result->served, index);
	inherited->kept[index] = false;
	inherited->states[index] = PAYLOAD_NONE;
}

/* ---- the end of a grace ---- */

static void end_grace(struct inherited *inherited)
{
	struct served *served = inherited->served;
	struct cache *cache = inherited->takeover->cache;

	for (uint32_t i = 0; i < inherited->directory_count; i++) {
		struct wire_directory *directory = inherited->directories[i].base;

		atomic_store_explicit(&directory->epoch, 0, memory_order_release);
	}
	/*
	 * Before any of it can be evicted.  Pairs with the acquire fence after the bytes were read in
	 * ooc_still_valid().
	 */
	atomic_thread_fence(memory_order_seq_cst);
	for (uint32_t i = 0; i < inherited->directory_count; i++)
		handover_forget_directory(served, inherited->epochs[i]);
	for (uint32_t i = 0; i < inherited->payload_count; i++) {
		uint32_t index = inherited->order[i];

		if (inherited->kept[index])
			cache_release(cache, served, index);
	}
	takeover_forget(served);
}

void takeover_tick(struct takeover *takeover, uint64_t now_ns)
{
	LIST_FOR_EACH (link, &takeover->stores) {
		struct inherited *inherited = LIST_ENTRY(link, struct inherited, link);

		if (inherited->left == 0 && now_ns >= inherited->grace_end_ns)
			end_grace(inherited);
	}
}

void takeover_count(const struct takeover *takeover, struct takeover_counts *ret)
{
	*ret = takeover->counts;
	ret->graces = 0;
	LIST_FOR_EACH (link, &takeover->stores)
		ret->graces++;
}
