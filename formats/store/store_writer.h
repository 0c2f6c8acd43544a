/* SPDX-License-Identifier: MIT */
/**
 * store_writer.h - a new store, written and committed.
 *
 * Nothing is seen under the store's name before store_writer_commit() has flushed everything: the
 * bytes go to an unnamed file in the same folder (O_TMPFILE; where the file system has none, to a
 * hidden name that is removed), so that an interrupted build leaves nothing behind.
 *
 * Payloads are appended in the order of the calls; the caller decides that order, which is the
 * order on disk.  Writes are gathered into large aligned ones.
 *
 *	store_writer_create -> { store_writer_payload } -> store_writer_commit -> store_writer_destroy
 *
 * A failed write fails every write after it in the same way, and the commit.  A commit, whether it
 * succeeds or not, is the last thing but destroying the writer.
 *
 * Threads: one thread at a time.
 */
#ifndef FORMATS_STORE_STORE_WRITER_H
#define FORMATS_STORE_STORE_WRITER_H

#include <stddef.h>
#include <stdint.h>

#include "formats/base/why.h"
#include "formats/store/layout.h"

struct store_writer;

/** Returns: 0, -ENOMEM or -errno (-EEXIST never: an old store is replaced at commit). */
int store_writer_create(const char *path, struct store_writer **ret, struct why *why);

/** Gives up what was not committed.  NULL is allowed.  Returns: NULL. */
struct store_writer *store_writer_destroy(struct store_writer *writer);

/**
 * Appends one payload, already encoded, and fills the extent's fields of its record:
 * payload_id, file_offset, payload_checksum, stored_bytes, codec.
 *
 * payload_id:  > 0; the caller's, because a decoded payload carries it too.
 *
 * Returns: 0, -ENOSPC, -EIO or -errno.
 */
int store_writer_payload(struct store_writer *writer, uint64_t payload_id, uint32_t codec,
			 const void *stored, uint32_t stored_bytes, struct store_node *record,
			 struct why *why);

/** The names, as tables.  Every pointer is the caller's and only read. */
struct store_names_content {
	const struct store_section *sections;
	const struct store_source *sources;
	const struct store_part *parts;
	const char *strings; /* the first byte is NUL */
	uint64_t section_count;
	uint64_t source_count;
	uint64_t part_count;
	uint64_t string_bytes;
};

/**
 * Writes HS and names, flushes, writes superblock A with generation 1 (B is zero), flushes, and
 * gives the file its name, replacing what stood there.
 *
 * superblock:  the caller fills everything that describes the model (counts, grid, boxes, units);
 *              magic, version, uuid, generation, file_bytes, extents, checksum and the counts of
 *              parts and sections are filled here.
 * nodes:       the whole HS, in record order; a model without triangles has its root alone, of
 *              STORE_KIND_NONE, all zero but for parent, first_child and parent_error.
 *
 * Returns: 0, -EUCLEAN (no reader would open it: the caller's mistake, with the reason), -EINVAL
 *	(no nodes), -EOVERFLOW (names), -ENOSPC, -EIO, -ENOMEM or -errno; on failure the old store
 *	stands unchanged (but for the folder's flush: new_file.h).
 */
int store_writer_commit(struct store_writer *writer, struct store_superblock *superblock,
			const struct store_node *nodes, const struct store_names_content *names,
			struct why *why);

/** Bytes appended so far, pads included. */
uint64_t store_writer_bytes(const struct store_writer *writer);

#endif /* FORMATS_STORE_STORE_WRITER_H */
