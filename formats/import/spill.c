/* SPDX-License-Identifier: MIT */
#include "formats/import/spill.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/base/check.h"
#include "formats/base/file.h"

/* Opens a file that has no name, or loses it at once. */
static int open_nameless(const char *directory, struct why *why)
{
	char *path = NULL;
	int fd = open(directory, O_TMPFILE | O_RDWR | O_EXCL | O_CLOEXEC, 0600);

	if (fd >= 0)
		return fd;
	if (errno != EOPNOTSUPP && errno != EISDIR && errno != ENOENT)
		return why_errno(why, -errno, "cannot write scratch files in %s", directory);
	if (asprintf(&path, "%s/oocd-scratch-XXXXXX", directory) < 0)
		return why_set(why, -ENOMEM, "no memory for a path");
	fd = mkostemp(path, O_CLOEXEC);
	if (fd < 0)
		fd = why_errno(why, -errno, "cannot write scratch files in %s", directory);
	else
		(void)unlink(path);
	free(path);
	return fd;
}

int spill_create(struct scratch *scratch, uint32_t stream_count, uint32_t chunk_bytes,
		 struct spill **ret, struct why *why)
{
	struct spill *spill = calloc(1, sizeof(*spill));
	int r;

	if (!spill)
		return why_set(why, -ENOMEM, "no memory for scratch files");
	spill->scratch = scratch;
	spill->fd = -1;
	spill->chunk_bytes = chunk_bytes;
	spill->stream_count = stream_count;
	spill->streams = calloc(stream_count, sizeof(*spill->streams));
	if (!spill->streams) {
		spill_destroy(spill);
		return why_set(why, -ENOMEM, "no memory for scratch files");
	}
	r = open_nameless(scratch->directory, why);
	if (r < 0) {
		spill_destroy(spill);
		return r;
	}
	spill->fd = r;
	*ret = spill;
	return 0;
}

struct spill *spill_destroy(struct spill *spill)
{
	if (!spill)
		return NULL;
	for (uint32_t i = 0; spill->streams && i < spill->stream_count; i++) {
		struct spill_stream *stream = &spill->streams[i];

		spill->scratch->live_bytes -=
			(stream->chunk_count - stream->chunk_read) * spill->chunk_bytes;
		free(stream->buffer);
		free(stream->chunks);
	}
	free(spill->streams);
	spill->fd = fd_close(spill->fd);
	free(spill);
	return NULL;
}

static int check_cancelled(const struct spill *spill, struct why *why)
{
	const volatile bool *cancelled = spill->scratch->cancelled;

	return cancelled && *cancelled ? why_set(why, -ECANCELED, "cancelled") : 0;
}

/* Writes the buffer, whatever is in it, behind all other chunks. */
static int stream_flush(struct spill *spill, struct spill_stream *stream, struct why *why)
{
	struct scratch *scratch = spill->scratch;
	int r = check_cancelled(spill, why);

	if (r < 0)
		return r;
	if (stream->chunk_count == stream->chunk_capacity) {
		uint64_t capacity = stream->chunk_capacity ? 2 * stream->chunk_capacity : 8;
		uint64_t *chunks = realloc(stream->chunks, capacity * sizeof(*chunks));

		if (!chunks)
			return why_set(why, -ENOMEM, "no memory for scratch files");
		stream->chunks = chunks;
		stream->chunk_capacity = capacity;
	}
	r = file_write_at(spill->fd, stream->buffer, stream->buffered_bytes,
			  spill->chunk_count * spill->chunk_bytes);
	if (r < 0)
		return why_errno(why, r, "writing scratch files in %s failed", scratch->directory);
	stream->chunks[stream->chunk_count++] = spill->chunk_count++;
	stream->buffered_bytes = 0;
	scratch->live_bytes += spill->chunk_bytes;
	scratch->max_bytes = u64_max(scratch->max_bytes, scratch->live_bytes);
	return 0;
}

int spill_write(struct spill *spill, uint32_t stream_index, const void *data, uint32_t size_bytes,
		struct why *why)
{
	struct spill_stream *stream = &spill->streams[stream_index];
	const uint8_t *from = data;

	CHECK(stream_index < spill->stream_count);
	if (!stream->buffer) {
		stream->buffer = malloc(spill->chunk_bytes);
		if (!stream->buffer)
			return why_set(why, -ENOMEM, "no memory for scratch files");
	}
	while (size_bytes > 0) {
		uint32_t room_bytes = spill->chunk_bytes - stream->buffered_bytes;
		uint32_t piece_bytes = size_bytes < room_bytes ? size_bytes : room_bytes;

		if (room_bytes == 0) {
			int r = stream_flush(spill, stream, why);

			if (r < 0)
				return r;
			continue;
		}
		memcpy(stream->buffer + stream->buffered_bytes, from, piece_bytes);
		stream->buffered_bytes += piece_bytes;
		from += piece_bytes;
		size_bytes -= piece_bytes;
	}
	return 0;
}

/* Makes the next chunk the buffer.  Returns 1, 0 when there is none, or an error. */
static int stream_refill(struct spill *spill, struct spill_stream *stream, struct why *why)
{
	uint64_t file_offset;
	int r = check_cancelled(spill, why);

	if (r < 0 || stream->chunk_read == stream->chunk_count)
		return r;
	file_offset = stream->chunks[stream->chunk_read] * spill->chunk_bytes;
	stream->buffered_bytes = spill->chunk_bytes;
	if (stream->chunk_read + 1 == stream->chunk_count)
		stream->buffered_bytes = stream->last_bytes;
	r = file_read_at(spill->fd, stream->buffer, stream->buffered_bytes, file_offset);
	if (r < 0)
		return why_errno(why, r, "reading scratch files failed");
	/* Where the file system cannot do it, room is given back when the file is closed. */
	(void)fallocate(spill->fd, FALLOC_FL_PUNCH_HOLE | FALLOC_FL_KEEP_SIZE, (off_t)file_offset,
			spill->chunk_bytes);
	spill->scratch->live_bytes -= spill->chunk_bytes;
	stream->chunk_read++;
	stream->read_bytes = 0;
	return 1;
}

/*
 * From here on the stream is read: what is in the buffer becomes its last chunk, unless it is all
 * there is, which never sees the disk.
 */
static int stream_begin_reading(struct spill *spill, struct spill_stream *stream, struct why *why)
{
	stream->reading = true;
	stream->last_bytes = stream->buffered_bytes;
	return stream->chunk_count > 0 ? stream_flush(spill, stream, why) : 0;
}

int spill_read(struct spill *spill, uint32_t stream_index, void *data, uint32_t size_bytes,
	       struct why *why)
{
	struct spill_stream *stream = &spill->streams[stream_index];
	uint32_t done_bytes = 0;

	CHECK(stream_index < spill->stream_count);
	if (!stream->reading) {
		int r = stream_begin_reading(spill, stream, why);

		if (r < 0)
			return r;
	}
	while (done_bytes < size_bytes) {
		uint32_t there_bytes = stream->buffered_bytes - stream->read_bytes;
		uint32_t piece_bytes = size_bytes - done_bytes;

		if (there_bytes == 0) {
			int r = stream_refill(spill, stream, why);

			if (r > 0)
				continue;
			if (r < 0 || done_bytes == 0)
				return r;
			return why_set(why, -EIO, "a scratch file ends too early");
		}
		if (piece_bytes > there_bytes)
			piece_bytes = there_bytes;
		memcpy((uint8_t *)data + done_bytes, stream->buffer + stream->read_bytes,
		       piece_bytes);
		stream->read_bytes += piece_bytes;
		done_bytes += piece_bytes;
	}
	return 1;
}

void spill_stream_done(struct spill *spill, uint32_t stream_index)
{
	struct spill_stream *stream = &spill->streams[stream_index];

	free(stream->buffer);
	stream->buffer = NULL;
}
