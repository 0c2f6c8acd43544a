/* SPDX-License-Identifier: MIT */
#include "formats/store/write_stream.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/base/check.h"
#include "formats/base/file.h"
#include "formats/store/layout.h"

/** Long enough that the device's latency does not count. */
#define BUFFER_BYTES (4 * MIB)

struct write_stream {
	int fd;
	int error;
	uint64_t file_offset; /* of the first byte gathered */
	size_t used_bytes;
	uint8_t *buffer; /* BUFFER_BYTES, aligned for O_DIRECT */
};

static void set_direct(int fd, int direct)
{
	int flags = fcntl(fd, F_GETFL);

	/* Where the file system has no O_DIRECT, the page cache does as well, only slower. */
	if (flags >= 0)
		(void)fcntl(fd, F_SETFL, direct ? flags | O_DIRECT : flags & ~O_DIRECT);
}

int write_stream_create(int fd, uint64_t file_offset, struct write_stream **ret)
{
	struct write_stream *stream = calloc(1, sizeof(*stream));

	CHECK(bytes_is_aligned(file_offset, STORE_BLOCK_BYTES));
	if (!stream)
		return -ENOMEM;
	stream->fd = fd;
	stream->file_offset = file_offset;
	stream->buffer = aligned_alloc(STORE_BLOCK_BYTES, BUFFER_BYTES);
	if (!stream->buffer) {
		write_stream_destroy(stream);
		return -ENOMEM;
	}
	set_direct(fd, 1);
	*ret = stream;
	return 0;
}

struct write_stream *write_stream_destroy(struct write_stream *stream)
{
	if (!stream)
		return NULL;
	free(stream->buffer);
	free(stream);
	return NULL;
}

uint64_t write_stream_offset(const struct write_stream *stream)
{
	return stream->file_offset + stream->used_bytes;
}

static int write_blocks(struct write_stream *stream, const void *data, size_t size_bytes,
			uint64_t file_offset)
{
	if (stream->error == 0)
		stream->error = file_write_at(stream->fd, data, size_bytes, file_offset);
	/* The descriptor took O_DIRECT, the file system or a short write's rest does not. */
	if (stream->error == -EINVAL) {
		set_direct(stream->fd, 0);
		stream->error = file_write_at(stream->fd, data, size_bytes, file_offset);
	}
	return stream->error;
}

int write_stream_flush(struct write_stream *stream)
{
	int r;

	CHECK(bytes_is_aligned(stream->used_bytes, STORE_BLOCK_BYTES));
	r = write_blocks(stream, stream->buffer, stream->used_bytes, stream->file_offset);
	if (r < 0)
		return r;
	stream->file_offset += stream->used_bytes;
	stream->used_bytes = 0;
	return 0;
}

int write_stream_append(struct write_stream *stream, const void *data, size_t size_bytes)
{
	const uint8_t *bytes = data;

	while (size_bytes > 0) {
		size_t n = u64_min(size_bytes, BUFFER_BYTES - stream->used_bytes);
		int r;

		memcpy(stream->buffer + stream->used_bytes, bytes, n);
		stream->used_bytes += n;
		bytes += n;
		size_bytes -= n;
		if (stream->used_bytes < BUFFER_BYTES)
			break;
		r = write_stream_flush(stream);
		if (r < 0)
			return r;
	}
	return stream->error;
}

int write_stream_align(struct write_stream *stream)
{
	size_t used = stream->used_bytes;
	size_t aligned = bytes_round_up(used, STORE_BLOCK_BYTES);

	/* The buffer's length is a multiple of the block's: the pad always fits. */
	memset(stream->buffer + used, 0, aligned - used);
	stream->used_bytes = aligned;
	return aligned == BUFFER_BYTES ? write_stream_flush(stream) : stream->error;
}

int write_stream_put(struct write_stream *stream, const void *data, size_t size_bytes,
		     uint64_t file_offset)
{
	CHECK(stream->used_bytes == 0 && size_bytes <= BUFFER_BYTES);
	CHECK(bytes_is_aligned(size_bytes | file_offset, STORE_BLOCK_BYTES));
	memcpy(stream->buffer, data, size_bytes);
	return write_blocks(stream, stream->buffer, size_bytes, file_offset);
}
