/* SPDX-License-Identifier: MIT */
#include "formats/import/source.h"

#include <ctype.h>
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <zlib.h>

#include "formats/base/bytes.h"
#include "formats/base/check.h"
#include "formats/base/file.h"
#include "formats/import/number.h"

/* One read of a plain file is at least half of it, or all of a small file. */
#define WINDOW_BYTES     (2 * MIB)
#define WINDOW_BYTES_MIN (64 * KIB)
#define PACKED_BYTES     (512 * KIB)
/* Deflate codes at most 258 bytes in 2 bits. */
#define DEFLATE_RATIO_MAX 1032u

struct source_reader {
	int fd;
	bool gzip;
	bool ended;           /* of the file, or of the last gzip member */
	uint64_t taken_bytes; /* read from the file */
	uint8_t *window;
	size_t window_bytes;
	uint64_t window_bytes_max;
	source_progress_fn progress;
	void *arg;

	z_stream inflate;
	bool inflate_ready;
	uint8_t *packed; /* PACKED_BYTES */
};

struct source *source_close(struct source *source)
{
	struct source_reader *reader;

	if (!source)
		return NULL;
	reader = source->reader;
	if (reader) {
		if (reader->inflate_ready)
			(void)inflateEnd(&reader->inflate);
		reader->fd = fd_close(reader->fd);
		free(reader->packed);
		free(reader->window);
		free(reader);
	}
	free(source);
	return NULL;
}

/* Reads up to size_bytes; less only at the end of the file.  Returns the count or -errno. */
static int64_t reader_read(struct source_reader *reader, void *data, size_t size_bytes,
			   struct why *why)
{
	size_t done_bytes = 0;

	while (done_bytes < size_bytes) {
		ssize_t r = read(reader->fd, (uint8_t *)data + done_bytes, size_bytes - done_bytes);

		if (r < 0 && errno == EINTR)
			continue;
		if (r < 0)
			return why_errno(why, -errno, "reading failed");
		if (r == 0)
			break;
		done_bytes += (size_t)r;
	}
	reader->taken_bytes += done_bytes;
	return (int64_t)done_bytes;
}

static bool is_gzip(const uint8_t *bytes, size_t size_bytes)
{
	return size_bytes >= 3 && bytes[0] == 0x1f && bytes[1] == 0x8b && bytes[2] == 8;
}

/*
 * At the end of a gzip member: goes on with the next one, since files may be several gzip files
 * one after the other.  What follows and is no gzip is padding.
 */
static int reader_next_member(struct source_reader *reader, struct why *why)
{
	z_stream *z = &reader->inflate;

	if (z->avail_in < 3) {
		int64_t r;

		memmove(reader->packed, z->next_in, z->avail_in);
		r = reader_read(reader, reader->packed + z->avail_in, PACKED_BYTES - z->avail_in,
				why);
		if (r < 0)
			return (int)r;
		z->next_in = reader->packed;
		z->avail_in += (uInt)r;
	}
	if (is_gzip(z->next_in, z->avail_in))
		(void)inflateReset(z);
	else
		reader->ended = true;
	return 0;
}

/* Decodes up to size_bytes; 0 only at the end. */
static int64_t reader_inflate(struct source_reader *reader, uint8_t *data, size_t size_bytes,
			      struct why *why)
{
	z_stream *z = &reader->inflate;

	z->next_out = data;
	z->avail_out = (uInt)size_bytes;
	while (z->avail_out == (uInt)size_bytes && !reader->ended) {
		int r;

		if (z->avail_in == 0) {
			int64_t got = reader_read(reader, reader->packed, PACKED_BYTES, why);

			if (got < 0)
				return got;
			if (got == 0)
				return why_set(why, -ENODATA, "the gzip file is cut off");
			z->next_in = reader->packed;
			z->avail_in = (uInt)got;
		}
		r = inflate(z, Z_NO_FLUSH);
		if (r == Z_STREAM_END) {
			r = reader_next_member(reader, why);
			if (r < 0)
				return r;
		} else if (r == Z_MEM_ERROR) {
			return why_set(why, -ENOMEM, "no memory to decode gzip");
		} else if (r != Z_OK && r != Z_BUF_ERROR) {
			return why_set(why, -EUCLEAN, "the gzip data is damaged: %s",
				       z->msg ? z->msg : "wrong structure");
		}
	}
	return (int64_t)(size_bytes - z->avail_out);
}

/* Makes room behind the window: moves it to the front, or grows the buffer when it fills it. */
static int source_make_room(struct source *source, struct why *why)
{
	struct source_reader *reader = source->reader;
	size_t kept_bytes = (size_t)(source->end - source->at);

	if (kept_bytes < reader->window_bytes) {
		memmove(reader->window, source->at, kept_bytes);
	} else {
		size_t grown_bytes = reader->window_bytes * 2;
		uint8_t *grown;

		/* A full window was filled from its front. */
		CHECK(source->at == reader->window);
		if (grown_bytes > reader->window_bytes_max)
			return why_set(why, -EUCLEAN, "a line or record of more than %zu bytes",
				       reader->window_bytes);
		grown = realloc(reader->window, grown_bytes + 1);
		if (!grown)
			return why_set(why, -ENOMEM, "no memory for a line of %zu bytes",
				       grown_bytes);
		reader->window = grown;
		reader->window_bytes = grown_bytes;
	}
	source->at = reader->window;
	source->end = reader->window + kept_bytes;
	return 0;
}

int source_more(struct source *source, struct why *why)
{
	struct source_reader *reader = source->reader;
	size_t kept_bytes, room_bytes;
	int64_t got;
	int r;

	if (reader->ended)
		return 0;
	r = source_make_room(source, why);
	if (r < 0)
		return r;
	kept_bytes = (size_t)(source->end - source->at);
	room_bytes = reader->window_bytes - kept_bytes;
	if (reader->gzip)
		got = reader_inflate(reader, reader->window + kept_bytes, room_bytes, why);
	else
		got = reader_read(reader, reader->window + kept_bytes, room_bytes, why);
	if (got < 0) {
		reader->window[kept_bytes] = 0;
		return (int)got;
	}
	if (got == 0)
		reader->ended = true;
	reader->window[kept_bytes + (size_t)got] = 0;
	source->end += got;
	source->end_offset += (uint64_t)got;
	if (reader->progress) {
		r = reader->progress(reader->arg, reader->taken_bytes, source->file_bytes);
		if (r < 0)
			return r;
	}
	return got > 0;
}

/* Looks at the first bytes, makes the window, sets gzip up. */
static int source_begin(struct source *source, struct why *why)
{
	struct source_reader *reader = source->reader;
	uint8_t magic[3];
	ssize_t r = pread(reader->fd, magic, sizeof(magic), 0);

	if (r < 0)
		return why_errno(why, -errno, "reading failed");
	reader->gzip = is_gzip(magic, (size_t)r);
	/* A byte more than the file, so that one read sees its end; thousands of models are small. */
	reader->window_bytes = WINDOW_BYTES;
	if (!reader->gzip && source->file_bytes < WINDOW_BYTES)
		reader->window_bytes = u64_max(source->file_bytes + 1, WINDOW_BYTES_MIN);
	reader->window = malloc(reader->window_bytes + 1);
	if (!reader->window)
		return why_set(why, -ENOMEM, "no memory to read it");
	reader->window[0] = 0;
	source->at = reader->window;
	source->end = reader->window;
	if (reader->gzip) {
		reader->packed = malloc(PACKED_BYTES);
		if (!reader->packed || inflateInit2(&reader->inflate, 15 + 16) != Z_OK)
			return why_set(why, -ENOMEM, "no memory to decode gzip");
		reader->inflate_ready = true;
	}
	r = source_more(source, why);
	return r < 0 ? (int)r : 0;
}

/* Opens what is a regular file; a pipe or a device would block or never end. */
static int source_open_file(struct source *source, const char *path, struct why *why)
{
	struct stat status;

	source->reader->fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY);
	if (source->reader->fd < 0)
		return why_errno(why, -errno, "cannot open it");
	if (fstat(source->reader->fd, &status) < 0)
		return why_errno(why, -errno, "cannot examine it");
	if (S_ISDIR(status.st_mode))
		return why_set(why, -EISDIR, "it is a folder");
	if (!S_ISREG(status.st_mode))
		return why_set(why, -EINVAL, "it is no regular file");
	source->file_bytes = (uint64_t)status.st_size;
	(void)posix_fadvise(source->reader->fd, 0, 0, POSIX_FADV_SEQUENTIAL);
	return 0;
}

int source_open(const char *path, uint64_t window_bytes_max, source_progress_fn progress, void *arg,
		struct source **ret, struct why *why)
{
	struct source *source = calloc(1, sizeof(*source));
	int r = -ENOMEM;

	if (!source)
		goto err_memory;
	source->reader = calloc(1, sizeof(*source->reader));
	if (!source->reader)
		goto err_memory;
	source->reader->fd = -1;
	source->reader->window_bytes_max = window_bytes_max;
	source->reader->progress = progress;
	source->reader->arg = arg;
	r = source_open_file(source, path, why);
	if (r < 0)
		goto err_close;
	r = source_begin(source, why);
	if (r < 0)
		goto err_close;
	*ret = source;
	return 0;

err_memory:
	(void)why_set(why, -ENOMEM, "no memory to read it");
err_close:
	source_close(source);
	return r;
}

int source_need(struct source *source, size_t size_bytes, struct why *why)
{
	while ((size_t)(source->end - source->at) < size_bytes) {
		int r = source_more(source, why);

		if (r < 0)
			return r;
		if (r == 0)
			return why_set(why, -ENODATA, "it ends too early, at byte %llu",
				       (unsigned long long)source->end_offset);
	}
	return 0;
}

int source_skip(struct source *source, uint64_t size_bytes, struct why *why)
{
	while (size_bytes > 0) {
		uint64_t piece_bytes;
		int r = source_need(source, 1, why);

		if (r < 0)
			return r;
		piece_bytes = u64_min(size_bytes, (uint64_t)(source->end - source->at));
		source->at += piece_bytes;
		size_bytes -= piece_bytes;
	}
	return 0;
}

int source_copy(struct source *source, void *data, uint64_t size_bytes, struct why *why)
{
	uint8_t *out = data;

	while (size_bytes > 0) {
		uint64_t piece_bytes;
		int r = source_need(source, 1, why);

		if (r < 0)
			return r;
		piece_bytes = u64_min(size_bytes, (uint64_t)(source->end - source->at));
		memcpy(out, source->at, piece_bytes);
		source->at += piece_bytes;
		out += piece_bytes;
		size_bytes -= piece_bytes;
	}
	return 0;
}

int source_line(struct source *source, const char **ret_line, size_t *ret_length, struct why *why)
{
	size_t seen_bytes = 0;

	for (;;) {
		const uint8_t *from = source->at + seen_bytes;
		const uint8_t *found = memchr(from, '\n', (size_t)(source->end - from));
		int r;

		if (found) {
			*ret_line = (const char *)source->at;
			*ret_length = (size_t)(found - source->at);
			source->at = found + 1;
			source->line++;
			return 1;
		}
		seen_bytes = (size_t)(source->end - source->at);
		r = source_more(source, why);
		if (r < 0)
			return r;
		if (r > 0)
			continue;
		if (seen_bytes == 0)
			return 0;
		/* The last line lacks its end. */
		*ret_line = (const char *)source->at;
		*ret_length = seen_bytes;
		source->at = source->end;
		source->line++;
		return 1;
	}
}

/*
 * A number that is read this close to the end of the window may go on behind it ("1e" and "5",
 * "inf" and "inity").
 */
#define NUMBER_TAIL_BYTES 8

/* Must more bytes be seen before the number that ends at `end` (NULL: none) is believed? */
static bool number_is_cut(const struct source *source, const char *end)
{
	const uint8_t *from = end ? (const uint8_t *)end : source->at;

	return source->end - from <= NUMBER_TAIL_BYTES && !source->reader->ended;
}

/* Could the byte be part of a number or word, so that what is before it is none? */
static bool continues_word(uint8_t byte)
{
	return isalnum(byte) || byte == '.' || byte == '+' || byte == '-' || byte == '_';
}

static int number_end(struct source *source, const char *end, struct why *why)
{
	int word_length = 0;

	if (end && !continues_word((uint8_t)*end)) {
		source->at = (const uint8_t *)end;
		return 0;
	}
	while (word_length < 20 && source->at[word_length] > ' ' && source->at[word_length] < 127)
		word_length++;
	return why_set(why, -EUCLEAN, "line %llu: a number is wanted where \"%.*s\" stands",
		       (unsigned long long)source->line + 1, word_length, (const char *)source->at);
}

/* The three differ in the type alone. */
#define SOURCE_NUMBER(function, type, parse)                                                       \
	int function(struct source *source, type *ret, struct why *why)                            \
	{                                                                                          \
		for (;;) {                                                                         \
			const char *end;                                                           \
			int r = source_blanks(source, why);                                        \
                                                                                                   \
			if (r < 0)                                                                 \
				return r;                                                          \
			if (r == 0)                                                                \
				return why_set(why, -ENODATA, "line %llu: it ends too early",      \
					       (unsigned long long)source->line + 1);              \
			end = parse((const char *)source->at, ret);                                \
			if (!number_is_cut(source, end))                                           \
				return number_end(source, end, why);                               \
			r = source_more(source, why);                                              \
			if (r < 0)                                                                 \
				return r;                                                          \
		}                                                                                  \
	}

SOURCE_NUMBER(source_double, double, number_to_double)
SOURCE_NUMBER(source_float, float, number_to_float)
SOURCE_NUMBER(source_i64, int64_t, number_to_i64)

uint64_t source_rest_max(const struct source *source)
{
	const struct source_reader *reader = source->reader;
	uint64_t window_bytes = (uint64_t)(source->end - source->at);
	uint64_t packed_bytes;

	if (reader->ended)
		return window_bytes;
	packed_bytes = source->file_bytes - u64_min(reader->taken_bytes, source->file_bytes);
	if (!reader->gzip)
		return window_bytes + packed_bytes;
	packed_bytes += reader->inflate.avail_in;
	if (packed_bytes > UINT64_MAX / DEFLATE_RATIO_MAX / 2)
		return UINT64_MAX;
	/* What zlib keeps inside is decoded at most once more: its own window. */
	return window_bytes + 64 * KIB + packed_bytes * DEFLATE_RATIO_MAX;
}

bool source_is_plain(const struct source *source)
{
	return !source->reader->gzip;
}
