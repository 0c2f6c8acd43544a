/* SPDX-License-Identifier: MIT */
/*
 * Bytes that claim to be a trace: first as they are, then with their checksums made right, so that
 * the judge of events behind them is reached.  What the reader gives must be sound.
 */
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

#include "formats/base/check.h"
#include "formats/base/file.h"
#include "formats/store/store_checksum.h"
#include "formats/trace/trace_reader.h"

#define INPUT_BYTES_MAX (1u << 20)

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size_bytes);

static void seal(uint8_t *data, size_t size_bytes)
{
	struct trace_header header;
	struct trace_block head;
	size_t at = sizeof(header);
	uint64_t number = 0;

	if (size_bytes < sizeof(header))
		return;
	memcpy(&header, data, sizeof(header));
	header.checksum = store_checksum(&header, offsetof(struct trace_header, checksum), 0);
	memcpy(data, &header, sizeof(header));
	while (size_bytes - at >= sizeof(head)) {
		memcpy(&head, data + at, sizeof(head));
		if (head.bytes > size_bytes - at - sizeof(head))
			return;
		head.checksum = store_checksum(data + at + sizeof(head), head.bytes, number++);
		memcpy(data + at, &head, sizeof(head));
		at += sizeof(head) + head.bytes;
	}
}

static void judge_event(const struct trace_reader *reader, const struct trace_event *event)
{
	CHECK(event->kind < TRACE_KIND_COUNT_);
	if (trace_kind_has_entry(event->kind) || event->kind == TRACE_NODE) {
		const struct trace_entry *entry = trace_reader_entry(reader, event->entry);
		const struct trace_store *store = trace_reader_store(reader, entry->store);

		CHECK(entry->node < store->node_count);
		CHECK(entry->pages > 0 && entry->pages <= TRACE_PAGES_MAX);
		CHECK(entry->bytes > 0 && entry->bytes <= TRACE_PAYLOAD_BYTES_MAX);
	}
	if (event->kind == TRACE_OPEN)
		CHECK(strlen(trace_reader_store(reader, event->store)->path) <=
		      TRACE_PATH_BYTES_MAX);
}

static void read_all(const uint8_t *data, size_t size_bytes)
{
	int fd = memfd_create("trace", MFD_CLOEXEC);
	struct trace_reader *reader;
	struct trace_event event;
	uint64_t ticks = 0;
	struct why why = { "" };
	int r;

	if (fd < 0 || file_write_at(fd, data, size_bytes, 0) < 0)
		abort();
	r = trace_reader_open(fd, &reader, &why);
	CHECK((r == 0) == (why.text[0] == '\0'));
	if (r < 0)
		return;
	while ((r = trace_reader_next(reader, &event, &why)) > 0) {
		judge_event(reader, &event);
		CHECK(event.ticks >= ticks);
		ticks = event.ticks;
	}
	CHECK((r == 0) == (why.text[0] == '\0'));
	trace_reader_close(reader);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size_bytes)
{
	uint8_t *copy;

	if (size_bytes > INPUT_BYTES_MAX)
		return 0;
	read_all(data, size_bytes);
	copy = malloc(size_bytes > 0 ? size_bytes : 1);
	if (!copy)
		abort();
	memcpy(copy, data, size_bytes);
	seal(copy, size_bytes);
	read_all(copy, size_bytes);
	free(copy);
	return 0;
}
