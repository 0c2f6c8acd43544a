/* SPDX-License-Identifier: MIT */
#include "formats/trace/trace_reader.h"

#include <errno.h>
#include <fcntl.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/check.h"
#include "formats/base/file.h"
#include "formats/store/store_checksum.h"

#define WANTED_NONE UINT64_MAX

/* A set of (session, entry): who wants what.  Open addressing, never more than half full. */
struct wanted {
	uint64_t *slots;
	size_t room; /* a power of two, or 0 */
	size_t count;
};

struct trace_reader {
	int fd;
	struct trace_header header;
	struct trace_code code;
	uint64_t file_offset;
	uint64_t block_number;
	uint64_t event_bytes;
	bool was_cut;

	struct trace_entry *entries;
	uint32_t entry_count;
	uint32_t entry_room;
	struct trace_store *stores;
	uint32_t store_count;
	uint32_t store_room;
	struct wanted wanted;

	uint32_t at;       /* in events */
	uint32_t at_count; /* bytes of events in the block */
	uint8_t events[TRACE_BLOCK_BYTES_MAX];
};

/* ---- who wants what ---- */

static size_t wanted_slot(const struct wanted *wanted, uint64_t key)
{
	size_t at = (size_t)(key * UINT64_C(0x9e3779b97f4a7c15) >> 20) & (wanted->room - 1);

	while (wanted->slots[at] != WANTED_NONE && wanted->slots[at] != key)
		at = (at + 1) & (wanted->room - 1);
	return at;
}

static int wanted_grow(struct wanted *wanted)
{
	struct wanted grown = { .room = wanted->room > 0 ? 2 * wanted->room : 1024 };

	grown.slots = malloc(grown.room * sizeof(*grown.slots));
	if (!grown.slots)
		return -ENOMEM;
	memset(grown.slots, 0xff, grown.room * sizeof(*grown.slots));
	grown.count = wanted->count;
	for (size_t i = 0; i < wanted->room; i++)
		if (wanted->slots[i] != WANTED_NONE)
			grown.slots[wanted_slot(&grown, wanted->slots[i])] = wanted->slots[i];
	free(wanted->slots);
	*wanted = grown;
	return 0;
}

static uint64_t wanted_key(const struct trace_event *event)
{
	return (uint64_t)event->session << 32 | event->entry;
}

/* Returns: 0, -EEXIST or -ENOMEM. */
static int wanted_add(struct wanted *wanted, uint64_t key)
{
	size_t at;

	if (2 * (wanted->count + 1) > wanted->room && wanted_grow(wanted) < 0)
		return -ENOMEM;
	at = wanted_slot(wanted, key);
	if (wanted->slots[at] == key)
		return -EEXIST;
	wanted->slots[at] = key;
	wanted->count++;
	return 0;
}

/* Returns: 0 or -ENOENT.  Those that stood behind it only because of it move up. */
static int wanted_remove(struct wanted *wanted, uint64_t key)
{
	size_t at;

	if (wanted->room == 0)
		return -ENOENT;
	at = wanted_slot(wanted, key);
	if (wanted->slots[at] != key)
		return -ENOENT;
	wanted->slots[at] = WANTED_NONE;
	wanted->count--;
	for (;;) {
		uint64_t moved;

		at = (at + 1) & (wanted->room - 1);
		moved = wanted->slots[at];
		if (moved == WANTED_NONE)
			return 0;
		wanted->slots[at] = WANTED_NONE;
		wanted->slots[wanted_slot(wanted, moved)] = moved;
	}
}

/* ---- opening ---- */

static int judge_header(const struct trace_header *header, struct why *why)
{
	if (memcmp(header->magic, TRACE_MAGIC, TRACE_MAGIC_BYTES) != 0)
		return why_set(why, -EUCLEAN, "it is no trace");
	if (header->version != TRACE_VERSION)
		return why_set(why, -EPROTONOSUPPORT,
			       "a trace of version %u: this program reads version %u",
			       header->version, TRACE_VERSION);
	if (store_checksum(header, offsetof(struct trace_header, checksum), 0) != header->checksum)
		return why_set(why, -EBADMSG, "its header is damaged: its checksum is wrong");
	if (header->page_bytes != TRACE_PAGE_BYTES || header->reserved != 0 ||
	    header->replacement[TRACE_NAME_BYTES - 1] != '\0')
		return why_set(why, -EUCLEAN, "its header cannot be");
	return 0;
}

int trace_reader_open(int fd, struct trace_reader **ret, struct why *why)
{
	struct trace_reader *reader = calloc(1, sizeof(*reader));
	int r;

	if (!reader) {
		(void)fd_close(fd);
		return why_errno(why, -ENOMEM, "reading a trace");
	}
	reader->fd = fd;
	r = file_read_at(fd, &reader->header, sizeof(reader->header), 0);
	if (r == -ENODATA)
		r = why_set(why, r, "too short for a trace");
	else if (r < 0)
		r = why_errno(why, r, "cannot be read");
	else
		r = judge_header(&reader->header, why);
	if (r < 0) {
		trace_reader_close(reader);
		return r;
	}
	reader->file_offset = sizeof(reader->header);
	*ret = reader;
	return 0;
}

int trace_reader_open_path(const char *path, struct trace_reader **ret, struct why *why)
{
	int fd = open(path, O_RDONLY | O_CLOEXEC | O_NOCTTY);
	int r;

	if (fd < 0)
		return why_errno(why, -errno, "%s", path);
	r = trace_reader_open(fd, ret, why);
	if (r < 0)
		why_prefix(why, "%s", path);
	return r;
}

struct trace_reader *trace_reader_close(struct trace_reader *reader)
{
	if (!reader)
		return NULL;
	for (uint32_t i = 0; i < reader->store_count; i++)
		free(reader->stores[i].path);
	free(reader->stores);
	free(reader->entries);
	free(reader->wanted.slots);
	(void)fd_close(reader->fd);
	free(reader);
	return NULL;
}

/* ---- blocks ---- */

/* Returns: 1, 0 (there is no further whole block), -EBADMSG, -EUCLEAN or -errno. */
static int next_block(struct trace_reader *reader, struct why *why)
{
	struct trace_block head;
	uint8_t byte;
	int r = file_read_at(reader->fd, &head, sizeof(head), reader->file_offset);

	if (r == -ENODATA) {
		reader->was_cut = file_read_at(reader->fd, &byte, 1, reader->file_offset) == 0;
		return 0;
	}
	if (r < 0)
		return why_errno(why, r, "block %llu", (unsigned long long)reader->block_number);
	if (head.bytes == 0 || head.bytes > TRACE_BLOCK_BYTES_MAX || head.reserved != 0)
		return why_set(why, -EUCLEAN, "block %llu cannot be",
			       (unsigned long long)reader->block_number);
	r = file_read_at(reader->fd, reader->events, head.bytes,
			 reader->file_offset + sizeof(head));
	if (r == -ENODATA) {
		reader->was_cut = true;
		return 0;
	}
	if (r < 0)
		return why_errno(why, r, "block %llu", (unsigned long long)reader->block_number);
	if (store_checksum(reader->events, head.bytes, reader->block_number) != head.checksum)
		return why_set(why, -EBADMSG, "block %llu is damaged: its checksum is wrong",
			       (unsigned long long)reader->block_number);
	reader->file_offset += sizeof(head) + head.bytes;
	reader->block_number++;
	reader->event_bytes += head.bytes;
	reader->at = 0;
	reader->at_count = head.bytes;
	return 1;
}

/* ---- events ---- */

static int grow(void **array, uint32_t count, uint32_t *room, size_t size_bytes)
{
	uint32_t wanted_room = *room > 0 ? *room + *room / 2 : 64;
	void *grown;

	if (count < *room)
		return 0;
	if (wanted_room < *room)
		return -ENOMEM;
	grown = reallocarray(*array, wanted_room, size_bytes);
	if (!grown)
		return -ENOMEM;
	*array = grown;
	*room = wanted_room;
	return 0;
}

static int take_open(struct trace_reader *reader, struct trace_event *event)
{
	void *stores = reader->stores;
	struct trace_store *store;
	char *path = strndup(event->path, event->path_bytes);
	int r = grow(&stores, reader->store_count, &reader->store_room, sizeof(*store));

	reader->stores = stores;
	if (r < 0 || !path) {
		free(path);
		return -ENOMEM;
	}
	event->store = reader->store_count++;
	store = &reader->stores[event->store];
	*store = (struct trace_store){ .path = path, .node_count = event->count };
	memcpy(store->uuid, event->uuid, sizeof(store->uuid));
	return 0;
}

static int take_node(struct trace_reader *reader, struct trace_event *event)
{
	void *entries = reader->entries;
	int r;

	if (event->store >= reader->store_count || reader->stores[event->store].closed ||
	    event->node >= reader->stores[event->store].node_count)
		return -EUCLEAN;
	r = grow(&entries, reader->entry_count, &reader->entry_room, sizeof(*reader->entries));
	reader->entries = entries;
	if (r < 0)
		return r;
	event->entry = reader->entry_count++;
	reader->entries[event->entry] = (struct trace_entry){
		.store = event->store,
		.node = event->node,
		.pages = event->pages,
		.bytes = event->bytes,
	};
	return 0;
}

static int take_close(struct trace_reader *reader, const struct trace_event *event)
{
	if (event->store >= reader->store_count || reader->stores[event->store].closed)
		return -EUCLEAN;
	reader->stores[event->store].closed = true;
	return 0;
}

static int take_event(struct trace_reader *reader, struct trace_event *event)
{
	if (trace_kind_has_entry(event->kind) && event->entry >= reader->entry_count)
		return -EUCLEAN;
	switch (event->kind) {
	case TRACE_OPEN:
		return take_open(reader, event);
	case TRACE_CLOSE:
		return take_close(reader, event);
	case TRACE_NODE:
		return take_node(reader, event);
	case TRACE_HIT:
	case TRACE_MISS:
		return wanted_add(&reader->wanted, wanted_key(event));
	case TRACE_DROP:
		return wanted_remove(&reader->wanted, wanted_key(event));
	case TRACE_BEGIN:
	case TRACE_END:
	case TRACE_SET:
	case TRACE_REFUSE:
	case TRACE_FETCH:
	case TRACE_PREFETCH:
	case TRACE_READY:
	case TRACE_FAIL:
	case TRACE_FREE:
	case TRACE_EVICT:
	case TRACE_ADOPT:
		return 0;
	case TRACE_TIME:
	case TRACE_SESSION:
	case TRACE_KIND_COUNT_:
		break;
	}
	/* trace_decode() gives none of these. */
	CHECK(false);
	return -EUCLEAN;
}

int trace_reader_next(struct trace_reader *reader, struct trace_event *ret, struct why *why)
{
	size_t used = 0;
	int r;

	if (reader->at == reader->at_count) {
		r = next_block(reader, why);
		if (r <= 0)
			return r;
	}
	r = trace_decode(&reader->code, reader->events + reader->at, reader->at_count - reader->at,
			 ret, &used);
	if (r == 0)
		r = take_event(reader, ret);
	if (r == -ENOMEM)
		return why_errno(why, r, "reading a trace");
	if (r < 0)
		return why_set(why, -EUCLEAN, "an event of block %llu, at byte %u, cannot be",
			       (unsigned long long)(reader->block_number - 1), reader->at);
	reader->at += (uint32_t)used;
	return 1;
}

const struct trace_header *trace_reader_header(const struct trace_reader *reader)
{
	return &reader->header;
}

bool trace_reader_was_cut(const struct trace_reader *reader)
{
	return reader->was_cut;
}

uint32_t trace_reader_entry_count(const struct trace_reader *reader)
{
	return reader->entry_count;
}

const struct trace_entry *trace_reader_entry(const struct trace_reader *reader, uint32_t entry)
{
	CHECK(entry < reader->entry_count);
	return &reader->entries[entry];
}

uint32_t trace_reader_store_count(const struct trace_reader *reader)
{
	return reader->store_count;
}

const struct trace_store *trace_reader_store(const struct trace_reader *reader, uint32_t store)
{
	CHECK(store < reader->store_count);
	return &reader->stores[store];
}

uint64_t trace_reader_event_bytes(const struct trace_reader *reader)
{
	return reader->event_bytes;
}
