/* SPDX-License-Identifier: MIT */
/**
 * codec.h - a payload's bytes on disk, from and to its bytes in memory.
 *
 * Decoding takes bytes from outside: a wrong length or a damaged frame is an error, never a write
 * past the destination.  It does not judge the payload (payload_validate() does).
 *
 * Every byte comes back, with one freedom: the index coder of MESHOPT may turn a triangle's
 * corners (a,b,c to b,c,a).  Order of triangles and winding stay; decoding what was decoded and
 * encoded again gives the same bytes.
 *
 * Threads: any; a struct codec_scratch belongs to one thread.
 */
#ifndef FORMATS_CODEC_CODEC_H
#define FORMATS_CODEC_CODEC_H

#include <stddef.h>
#include <stdint.h>

#include "formats/base/why.h"
#include "formats/store/layout.h"

/** Contexts that are dear to make; one a thread. */
struct codec_scratch;

/** Returns: 0 or -ENOMEM.  Takes memory when it is first used. */
int codec_scratch_create(struct codec_scratch **ret);
struct codec_scratch *codec_scratch_destroy(struct codec_scratch *scratch);

/** Room that codec_encode() may need for a payload. */
size_t codec_bound(enum store_codec codec, size_t payload_bytes);

/**
 * Encodes a valid payload.
 *
 * level:  zstd's, 1..19; ignored by the others.
 *
 * Returns: 0, -ENOBUFS when stored_bytes_max is too small, -ENOMEM.  The same bytes every time.
 */
int codec_encode(struct codec_scratch *scratch, enum store_codec codec, int level,
		 const void *payload, size_t payload_bytes, void *stored, size_t stored_bytes_max,
		 size_t *ret_stored_bytes);

/**
 * Decodes into exactly payload_bytes.  codec must not be NONE (there is nothing to decode).
 *
 * Returns: 0, -EUCLEAN with the reason, or -ENOMEM.
 */
int codec_decode(struct codec_scratch *scratch, enum store_codec codec, const void *stored,
		 size_t stored_bytes, void *payload, size_t payload_bytes, struct why *why);

/** "none", "zstd", "meshopt", "meshopt+zstd"; NULL for what is no codec. */
const char *codec_name(uint32_t codec);

/** Returns: the codec of a name, or -EINVAL. */
int codec_find(const char *name);

#endif /* FORMATS_CODEC_CODEC_H */
