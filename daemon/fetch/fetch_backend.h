/* SPDX-License-Identifier: MIT */
/**
 * fetch_backend.h - what reads pieces, behind fetch.h.
 *
 * A back end takes pieces and says what read(2) would have said of each; it does not retry, and it
 * may answer in any order.  At most `depth` pieces are with it at one time.
 *
 * Threads: loop thread, whatever threads it has inside.
 */
#ifndef DAEMON_FETCH_FETCH_BACKEND_H
#define DAEMON_FETCH_FETCH_BACKEND_H

#include <stddef.h>
#include <stdint.h>
#include <sys/uio.h>

#include "daemon/fetch/fetch.h"

#define FETCH_FILE_COUNT_MAX   512u
#define FETCH_BUFFER_COUNT_MAX 4352u
/** Events that are taken at one time. */
#define FETCH_REAP_COUNT_MAX 64u

struct fetch_piece {
	uint64_t tag;
	uint32_t file;
	uint32_t buffer; /* that the vector's one entry lies in, or FETCH_BUFFER_NONE */
	uint64_t file_offset;
	const struct iovec *vector; /* stays where it is until the piece has come back */
	uint32_t vector_count;      /* 1 .. FETCH_PART_COUNT_MAX */
};

struct fetch_event {
	uint64_t tag;
	int32_t result; /* bytes read, 0 at the end of the file, or a negative errno */
};

struct fetch_backend {
	const char *name;
	const struct fetch_backend_calls *calls;
};

struct fetch_backend_calls {
	/* Ends it and waits for every piece. */
	void (*destroy)(struct fetch_backend *backend);
	int (*set_file)(struct fetch_backend *backend, uint32_t file, int fd); /* -1: none */
	/* base NULL: none.  NULL: the back end has no use for buffers. */
	int (*set_buffer)(struct fetch_backend *backend, uint32_t buffer, void *base,
			  uint64_t bytes);
	void (*submit)(struct fetch_backend *backend, const struct fetch_piece *piece);
	void (*flush)(struct fetch_backend *backend);
	size_t (*reap)(struct fetch_backend *backend, struct fetch_event *events, size_t count_max);
	int (*fd)(const struct fetch_backend *backend);
};

int fetch_uring_create(uint32_t depth, struct fetch_backend **ret, struct why *why);
int fetch_pread_create(uint32_t depth, struct fetch_backend **ret, struct why *why);
int fetch_sim_create(uint32_t depth, const struct fetch_sim *sim, struct fetch_backend **ret,
		     struct why *why);

/**
 * Puts a slower disk around a back end.
 *
 * inner:  taken over, whatever happens.
 */
int fetch_disk_create(uint32_t depth, const struct disk_profile *profile,
		      struct fetch_backend *inner, struct fetch_backend **ret, struct why *why);

#endif /* DAEMON_FETCH_FETCH_BACKEND_H */
