/* SPDX-License-Identifier: MIT */
#include "daemon/fetch/fills.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

#include "daemon/cache/recorder.h"
#include "daemon/limits.h"
#include "formats/base/bytes.h"
#include "formats/base/check.h"
#include "formats/base/clock.h"
#include "formats/base/log.h"
#include "formats/codec/codec.h"
#include "formats/store/payload.h"
#include "formats/store/store_checksum.h"

enum fill_state {
	FILL_UNUSED = 0, /* on fills.unused */
	FILL_READING,    /* with the fetch layer; its destination belongs to the kernel */
	FILL_VERIFYING, /* on fills.read; then a worker's, who reads the source, writes the payload */
};

#define NO_STAGING UINT32_MAX

struct fill {
	struct worker_job job;
	struct list link;
	struct fills *fills;
	enum fill_state state;
	uint32_t generation; /* +1 at each use */
	struct served *served;
	const struct store_node *record;
	uint32_t index;
	uint32_t session;
	uint32_t staging_page; /* NO_STAGING: read in place */
	bool prefetch;
	bool begun_as_prefetch;
	uint64_t begun_ns;
	uint8_t *source;
	uint8_t *payload;
	uint64_t checksum; /* of the decoded payload; of one without codec, not taken */
	int error;
	struct why why;
};

/* Where coded payloads lie between read and decoding. */
struct staging {
	struct pages *pages;
	uint8_t *base;
	uint64_t bytes;
	uint32_t buffer;
};

struct fills {
	struct cache *cache;
	struct fetch *fetch;
	struct workers *workers;
	fills_ended_fn ended;
	void *ended_arg;
	fills_wanted_fn wanted; /* NULL: no takeover */
	void *wanted_arg;
	struct staging staging;
	uint64_t prefetch_bytes;  /* in flight */
	uint64_t prefetch_end_ns; /* since when there are none */
	struct fill_times times;
	uint32_t count;
	struct list unused;
	struct list read; /* what fills_verify() is to see to */
	struct fill fills[FILL_COUNT_MAX];
};

int fills_create(struct cache *cache, struct workers *workers, fills_ended_fn ended,
		 void *ended_arg, struct fills **ret, struct why *why)
{
	struct fills *fills = calloc(1, sizeof(*fills));

	if (!fills)
		return why_errno(why, -ENOMEM, "fills");
	fills->cache = cache;
	fills->workers = workers;
	fills->ended = ended;
	fills->ended_arg = ended_arg;
	fills->staging.buffer = FETCH_BUFFER_NONE;
	list_init(&fills->unused);
	list_init(&fills->read);
	for (uint32_t i = 0; i < FILL_COUNT_MAX; i++)
		list_push_back(&fills->unused, &fills->fills[i].link);
	*ret = fills;
	return 0;
}

static void staging_done(struct fills *fills)
{
	struct staging *staging = &fills->staging;

	if (staging->buffer != FETCH_BUFFER_NONE)
		fetch_remove_buffer(fills->fetch, staging->buffer);
	if (staging->base)
		(void)munmap(staging->base, staging->bytes);
	staging->pages = pages_destroy(staging->pages);
	staging->base = NULL;
	staging->bytes = 0;
	staging->buffer = FETCH_BUFFER_NONE;
}

struct fills *fills_destroy(struct fills *fills)
{
	if (!fills)
		return NULL;
	CHECK(fills->count == 0);
	/* The fetch layer has gone, and its buffers with it. */
	fills->staging.buffer = FETCH_BUFFER_NONE;
	staging_done(fills);
	free(fills);
	return NULL;
}

uint64_t fills_released_bytes(const struct fills *fills)
{
	return fills->cache->released_bytes;
}

void fills_set_fetch(struct fills *fills, struct fetch *fetch)
{
	fills->fetch = fetch;
}

void fills_set_takeover(struct fills *fills, fills_wanted_fn wanted, void *wanted_arg)
{
	fills->wanted = wanted;
	fills->wanted_arg = wanted_arg;
}

static uint32_t stored_pages(const struct store_node *record)
{
	return (uint32_t)(bytes_round_up(record->stored_bytes, WIRE_PAGE_BYTES) / WIRE_PAGE_BYTES);
}

static uint64_t largest_coded_bytes(const struct served *served)
{
	uint64_t largest_bytes = 0;

	for (uint32_t i = 0; i < served->node_count; i++)
		if (served->records[i].codec != STORE_CODEC_NONE)
			largest_bytes = u64_max(largest_bytes, served->records[i].stored_bytes);
	return bytes_round_up(largest_bytes, WIRE_PAGE_BYTES);
}

int fills_prepare(struct fills *fills, const struct served *served, struct why *why)
{
	struct staging *staging = &fills->staging;
	uint64_t largest_bytes = largest_coded_bytes(served);
	uint64_t bytes = u64_max(2 * largest_bytes, STAGING_BYTES_MIN);
	struct pages *pages;
	void *base;

	if (largest_bytes == 0 || bytes <= staging->bytes)
		return 0;
	/* What is in flight lies in the old one: the larger store is served from the next time on. */
	if (staging->pages && pages_free_count(staging->pages) < pages_count(staging->pages))
		return why_set(why, -EAGAIN,
			       "its payloads need more staging memory, which is in use");
	if (pages_create((uint32_t)(bytes / WIRE_PAGE_BYTES), &pages) < 0)
		return why_errno(why, -ENOMEM, "staging memory");
	base = mmap(NULL, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
	if (base == MAP_FAILED) {
		pages_destroy(pages);
		return why_errno(why, -ENOMEM, "staging memory");
	}
	(void)madvise(base, bytes, MADV_HUGEPAGE);
	staging_done(fills);
	*staging = (struct staging){ pages, base, bytes, FETCH_BUFFER_NONE };
	(void)fetch_add_buffer(fills->fetch, base, bytes, &staging->buffer);
	return 0;
}

/* ---- a fill's end ---- */

static enum wire_reason reason_of(int error)
{
	if (error == 0)
		return WIRE_REASON_NONE;
	if (error == -EBADMSG || error == -EUCLEAN)
		return WIRE_REASON_DAMAGED;
	return error == -ENOMEM ? WIRE_REASON_NO_MEMORY : WIRE_REASON_UNREADABLE;
}

static void fill_log(const struct fill *fill)
{
	struct served *served = fill->served;
	char node[16];
	const struct log_field about[] = { { "OOCD_STORE", served->path }, { "OOCD_NODE", node } };

	if (served->logged_count == STORE_LOG_LINES_MAX)
		return;
	served->logged_count++;
	(void)snprintf(node, sizeof(node), "%u", fill->index);
	log_write_about(LOG_LEVEL_ERROR, about, ARRAY_LENGTH(about),
			"%s: node %u, %u bytes at offset %llu: %s; the rest is served",
			served->path, fill->index, fill->record->stored_bytes,
			(unsigned long long)fill->record->file_offset, fill->why.text);
	if (served->logged_count == STORE_LOG_LINES_MAX)
		log_error("%s: more such nodes are only counted: see `oocctl verify`",
			  served->path);
}

/* The fill is no prefetch any more: it has ended, or somebody wants it. */
static void prefetch_leave(struct fills *fills, const struct fill *fill)
{
	CHECK(fills->prefetch_bytes >= fill->record->stored_bytes);
	fills->prefetch_bytes -= fill->record->stored_bytes;
	if (fills->prefetch_bytes == 0)
		fills->prefetch_end_ns = clock_now_ns();
}

static void fill_end(struct fill *fill, int error)
{
	struct fills *fills = fill->fills;
	struct fill_result result = {
		.served = fill->served,
		.index = fill->index,
		.session = fill->session,
		.prefetch = fill->prefetch,
		.read_bytes = fill->record->stored_bytes,
		.reason = reason_of(error),
	};

	if (fill->staging_page != NO_STAGING)
		pages_give(fills->staging.pages, fill->staging_page);
	if (fill->prefetch)
		prefetch_leave(fills, fill);
	histogram_add(fill->begun_as_prefetch ? &fills->times.prefetch : &fills->times.fetch,
		      clock_now_ns() - fill->begun_ns);
	if (error < 0)
		fill_log(fill);
	fill->state = FILL_UNUSED;
	list_push_back(&fills->unused, &fill->link);
	fills->count--;

	recorder_node(result.served, error == 0 ? TRACE_READY : TRACE_FAIL, result.index);
	if (error == 0) {
		cache_end_fill(fills->cache, result.served, result.index);
		fills->ended(fills->ended_arg, &result);
		return;
	}
	fills->ended(fills->ended_arg, &result);
	cache_fail_fill(fills->cache, result.served, result.index,
			result.reason == WIRE_REASON_DAMAGED);
}

/* On a worker; or on the loop thread, without scratch memory, where nothing is to be decoded. */
static void verify_run(struct worker_job *job, struct codec_scratch *scratch)
{
	struct fill *fill = LIST_ENTRY(job, struct fill, job);
	const struct store_node *record = fill->record;

	if (store_checksum(fill->source, record->stored_bytes, record->payload_id) !=
	    record->payload_checksum) {
		fill->error = why_set(&fill->why, -EBADMSG, "damaged: its checksum is wrong");
		return;
	}
	fill->error = 0;
	if (record->codec != STORE_CODEC_NONE)
		fill->error =
			codec_decode(scratch, record->codec, fill->source, record->stored_bytes,
				     fill->payload, record->payload_bytes, &fill->why);
	if (fill->error == 0)
		fill->error =
			payload_validate(fill->payload, record->payload_bytes, record, &fill->why);
	if (fill->error < 0)
		why_prefix(&fill->why, "damaged");
	else if (record->codec != STORE_CODEC_NONE)
		fill->checksum =
			store_checksum(fill->payload, record->payload_bytes, record->payload_id);
}

static void verify_done(struct worker_job *job)
{
	struct fill *fill = LIST_ENTRY(job, struct fill, job);

	CHECK(fill->state == FILL_VERIFYING);
	if (fill->error == 0 && fill->record->codec != STORE_CODEC_NONE)
		fill->served->ledger.checksums[fill->index] = fill->checksum;
	fill_end(fill, fill->error);
}

void fills_read_done(void *arg, uint64_t tag, int error)
{
	struct fills *fills = arg;
	uint32_t index = (uint32_t)tag;
	struct fill *fill;

	CHECK(index < FILL_COUNT_MAX);
	fill = &fills->fills[index];
	CHECK(fill->state == FILL_READING);
	CHECK(fill->generation == (uint32_t)(tag >> 32));
	if (error < 0) {
		if (error == -ENODATA)
			why_set(&fill->why, error, "the file ends before it");
		else
			why_errno(&fill->why, error, "cannot be read");
		fill_end(fill, error);
		return;
	}
	fill->served->counters.read_bytes += fill->record->stored_bytes;
	fill->state = FILL_VERIFYING;
	list_push_back(&fills->read, &fill->link);
}

void fills_verify(struct fills *fills)
{
	uint64_t here_bytes = 0;
	struct list here;

	if (list_is_empty(&fills->read))
		return;
	list_init(&here);
	LIST_FOR_EACH (link, &fills->read) {
		struct fill *fill = LIST_ENTRY(link, struct fill, link);

		list_remove(link);
		if (fill->job.is_short &&
		    here_bytes + fill->record->stored_bytes <= VERIFY_HERE_BYTES) {
			here_bytes += fill->record->stored_bytes;
			list_push_back(&here, link);
		} else {
			workers_add(fills->workers, &fill->job);
		}
	}
	workers_flush(fills->workers);
	LIST_FOR_EACH (link, &here) {
		struct fill *fill = LIST_ENTRY(link, struct fill, link);

		list_remove(link);
		verify_run(&fill->job, NULL);
		verify_done(&fill->job);
	}
}

/* ---- a fill's begin ---- */

static int staging_take(struct fills *fills, const struct store_node *record, uint32_t *ret_page)
{
	*ret_page = NO_STAGING;
	if (record->codec == STORE_CODEC_NONE)
		return 0;
	if (pages_take(fills->staging.pages, stored_pages(record), 0, ret_page) < 0)
		return -EAGAIN;
	return 0;
}

static void fill_read(struct fills *fills, struct fill *fill)
{
	struct served *served = fill->served;
	struct place place = served->nodes[fill->index].place;
	struct fetch_request request = {
		.file = served->file,
		.owner = fill->session,
		.buffer = served->arena.by_number[place.segment]->buffer,
		.file_offset = fill->record->file_offset,
		.bytes = fill->record->stored_bytes,
		.tag = (uint64_t)fill->generation << 32 | (uint64_t)(fill - fills->fills),
	};
	int r;

	fill->payload = arena_address(&served->arena, place);
	fill->source = fill->payload;
	if (fill->staging_page != NO_STAGING) {
		fill->source = fills->staging.base + (size_t)fill->staging_page * WIRE_PAGE_BYTES;
		request.buffer = fills->staging.buffer;
	}
	request.destination = fill->source;
	fill->state = FILL_READING;
	r = fetch_start(fills->fetch, &request);
	/* It has an entry for every fill. */
	CHECK(r == 0);
}

/* Was it evicted a moment ago?  Then another node should have been. */
static bool is_regretted(const struct node *node)
{
	return node->was_evicted && clock_now_ds() - node->since_ds < REGRET_DS;
}

/* The node is BUSY with this fill, whose room in the staging is taken. */
static void fill_begin(struct fills *fills, struct fill *fill, struct served *served,
		       uint32_t index, uint32_t staging_page)
{
	list_remove(&fill->link);
	fills->count++;
	fill->generation++;
	fill->job = (struct worker_job){
		.is_short = served->records[index].codec == STORE_CODEC_NONE,
		.run = verify_run,
		.done = verify_done,
	};
	list_init(&fill->job.link);
	fill->fills = fills;
	fill->served = served;
	fill->record = &served->records[index];
	fill->index = index;
	fill->session = 0;
	fill->prefetch = false;
	fill->begun_as_prefetch = false;
	fill->begun_ns = clock_now_ns();
	fill->staging_page = staging_page;
}

int fills_start(struct fills *fills, struct served *served, uint32_t index, uint32_t session,
		bool prefetch)
{
	const struct store_node *record = &served->records[index];
	struct fill *fill;
	bool regretted = is_regretted(&served->nodes[index]);
	uint32_t staging_page;
	int r;

	if (list_is_empty(&fills->unused))
		return -EAGAIN;
	r = staging_take(fills, record, &staging_page);
	if (r < 0)
		return r;
	fill = LIST_ENTRY(fills->unused.next, struct fill, link);
	r = cache_begin_fill(fills->cache, served, index, (uint32_t)(fill - fills->fills),
			     prefetch);
	if (r < 0) {
		if (staging_page != NO_STAGING)
			pages_give(fills->staging.pages, staging_page);
		return r;
	}
	fill_begin(fills, fill, served, index, staging_page);
	fill->session = session;
	fill->prefetch = prefetch;
	fill->begun_as_prefetch = prefetch;
	served->nodes[index].payer = session;
	served->nodes[index].unused_prefetch = prefetch;
	if (prefetch) {
		fills->prefetch_bytes += record->stored_bytes;
		served->counters.prefetches++;
	} else {
		served->counters.fetches++;
		served->counters.regrets += regretted;
	}
	recorder_node(served, prefetch ? TRACE_PREFETCH : TRACE_FETCH, index);
	fill_read(fills, fill);
	return 0;
}

int fills_again(struct fills *fills, struct served *served, uint32_t index)
{
	struct fill *fill;
	uint32_t staging_page;

	CHECK(served->nodes[index].fill == NODE_TAKEOVER);
	if (!fills_has_room(fills) ||
	    staging_take(fills, &served->records[index], &staging_page) < 0)
		return -EAGAIN;
	fill = LIST_ENTRY(fills->unused.next, struct fill, link);
	node_change_fill(&served->nodes[index], (uint32_t)(fill - fills->fills));
	fill_begin(fills, fill, served, index, staging_page);
	served->counters.fetches++;
	recorder_node(served, TRACE_FETCH, index);
	fill_read(fills, fill);
	return 0;
}

void fills_upgrade(struct fills *fills, const struct served *served, uint32_t index)
{
	const struct node *node = &served->nodes[index];
	struct fill *fill;

	CHECK(node->state == NODE_BUSY);
	if (node->fill == NODE_TAKEOVER) {
		fills->wanted(fills->wanted_arg, served, index);
		return;
	}
	fill = &fills->fills[node->fill];
	CHECK(fill->served == served && fill->index == index);
	if (!fill->prefetch)
		return;
	fill->prefetch = false;
	fill->served->counters.upgrades++;
	prefetch_leave(fills, fill);
}

bool fills_has_room(const struct fills *fills)
{
	return fetch_has_room(fills->fetch) && !list_is_empty(&fills->unused);
}

bool fills_has_room_for(const struct fills *fills, uint32_t session, bool shared)
{
	uint32_t depth = fetch_depth(fills->fetch);
	uint32_t pieces_max = shared ? depth - depth / FETCH_RESERVE_SHARE : UINT32_MAX;

	return fetch_has_room_for(fills->fetch, session, pieces_max) &&
	       !list_is_empty(&fills->unused);
}

/* None begins while a fetch waits, so those that are read then were begun before it was wanted. */
void fills_note_wait(struct fills *fills, uint64_t wanted_ns)
{
	uint64_t now_ns = clock_now_ns();
	uint64_t end_ns = fills->prefetch_bytes > 0 ? now_ns : fills->prefetch_end_ns;

	histogram_add(&fills->times.wait, now_ns - wanted_ns);
	histogram_add(&fills->times.wait_behind_prefetch,
		      end_ns > wanted_ns ? end_ns - wanted_ns : 0);
}

bool fills_has_prefetch_room(const struct fills *fills)
{
	return fills_has_room(fills) && fills->prefetch_bytes < PREFETCH_FLIGHT_BYTES;
}

const struct fill_times *fills_times(const struct fills *fills)
{
	return &fills->times;
}

uint32_t fills_count(const struct fills *fills)
{
	return fills->count;
}
