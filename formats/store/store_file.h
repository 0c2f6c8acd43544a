/* SPDX-License-Identifier: MIT */
/**
 * store_file.h - a store that is open for reading.
 *
 * Opening picks the newest valid superblock and judges all that later code relies on: after
 * store_open() and store_load_hs() no offset, count or link of the store needs another check.  It
 * never maps the file, for a truncation would then be a SIGBUS.
 *
 * Threads: a struct store_file may be read from any thread; opening and closing are the owner's.
 */
#ifndef FORMATS_STORE_STORE_FILE_H
#define FORMATS_STORE_STORE_FILE_H

#include <stddef.h>
#include <stdint.h>

#include "formats/base/why.h"
#include "formats/store/layout.h"

struct store_file;

/**
 * Opens a store on a descriptor.
 *
 * fd:   open for reading, of a regular file.
 *
 * Returns: 0, or
 *	-EUCLEAN  no superblock is whole, or what it says cannot be
 *	-EPROTONOSUPPORT  a newer version of the format
 *	-ENODATA  the file is shorter than the store
 *	-EINVAL   not a regular file, or not a store at all
 *	-ENOMEM, or what reading said
 * Ownership: takes fd on success only; ends with store_close().
 */
int store_open(int fd, struct store_file **ret, struct why *why);

/** The same by path. */
int store_open_path(const char *path, struct store_file **ret, struct why *why);

/** NULL is allowed. Returns: NULL. */
struct store_file *store_close(struct store_file *store);

int store_fd(const struct store_file *store);

/**
 * Reads one of the two superblocks, 0 or 1, as it lies.  It may be the older one.
 *
 * Returns: 0, -EINVAL (its magic is not there), -EUCLEAN (checksum), -EPROTONOSUPPORT, -ENODATA or
 *	-errno.  ret is set to what was read unless reading failed.
 */
int store_read_superblock(int fd, uint32_t slot, struct store_superblock *ret, struct why *why);

/** Valid until store_close(). */
const struct store_superblock *store_superblock(const struct store_file *store);

/**
 * Reads the HS into the caller's memory and judges it: checksums, links, order, cells inside
 * parents, finite boxes, extents inside the file and apart from each other, counts that add up.
 *
 * nodes:  room for superblock.node_count records.
 *
 * Returns: 0, -EBADMSG (checksum; names the records), -EUCLEAN (structure), -ENOMEM or -errno.
 */
int store_load_hs(const struct store_file *store, struct store_node *nodes, struct why *why);

/** The names block, decoded and judged.  Strings end inside it. */
struct store_names {
	const struct store_names_header *header;
	const struct store_section *sections;
	const struct store_source *sources;
	const struct store_part *parts;
	const char *strings;
	void *memory; /* what the pointers above point into */
};

/** Returns: 0, -EBADMSG, -EUCLEAN, -ENOMEM or -errno.  Ends with store_names_done(). */
int store_load_names(const struct store_file *store, struct store_names *ret, struct why *why);
void store_names_done(struct store_names *names);

/**
 * Reads, verifies, decodes and judges one node's payload.
 *
 * payload:  node->payload_bytes of room, 16-byte aligned.
 * scratch:  node->stored_bytes of room, or NULL for nodes without codec.
 *
 * Returns: 0, -EBADMSG (checksum), -EUCLEAN (structure), -ENODATA, -ENOMEM or -errno.
 */
int store_read_payload(const struct store_file *store, const struct store_node *node, void *payload,
		       void *scratch, struct why *why);

/** What a pass over every byte found. */
struct store_verify_summary {
	uint64_t nodes_read;
	uint64_t nodes_damaged;
	uint64_t bytes_read;
};

/** Told of each damaged node or block; node_index is STORE_NODE_NONE for what is no node. */
typedef void (*store_damage_fn)(void *arg, uint32_t node_index, int error, const struct why *why);

/**
 * Reads every byte of a store: both superblocks, HS, names, payloads, and the zeros between.
 * `store` may be NULL-opened: a path is taken, so that a store that does not open is reported too.
 *
 * Returns: 0 when all is whole, -EBADMSG when something is damaged (each told), or -errno.
 */
int store_verify_path(const char *path, store_damage_fn damage, void *arg,
		      struct store_verify_summary *ret, struct why *why);

#endif /* FORMATS_STORE_STORE_FILE_H */
