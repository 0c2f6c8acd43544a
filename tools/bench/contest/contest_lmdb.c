/* SPDX-License-Identifier: MIT */
/*
 * LMDB, as its documentation advises: one environment, numbers as keys, a read-only transaction that is
 * renewed each frame (a reader's hold on what it reads), without thread-local slots; and no read-ahead
 * where the database is larger than memory.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "formats/base/bytes.h"
#include "formats/base/file.h"
#include "tools/bench/contest/contest.h"

#ifdef OOCD_HAS_LMDB
#include <lmdb.h>

/** Payloads that are written with one transaction. */
#define PUTS_AT_ONCE 64u

struct lmdb {
	const struct contest_config *config;
	char path[PATH_MAX];
	MDB_env *environment;
	MDB_txn *transaction;
	MDB_dbi table;
	bool is_larger; /* than memory */
};

static int lmdb_why(struct why *why, int error, const char *what)
{
	return why_set(why, -EIO, "LMDB: %s: %s", what, mdb_strerror(error));
}

static int environment_open(struct lmdb *self, unsigned flags, struct why *why)
{
	const struct contest_walk *walk = self->config->walk;
	/* A payload takes whole pages, and a number in a branch; half as much again is plenty. */
	uint64_t bytes = bytes_round_up(
		walk->distinct_bytes * 3 / 2 + walk->superblock.node_count * 8192 + 16 * MIB, MIB);
	int r = mdb_env_create(&self->environment);

	if (r == 0)
		r = mdb_env_set_mapsize(self->environment, bytes);
	if (r == 0)
		r = mdb_env_open(self->environment, self->path, flags | MDB_NOSUBDIR | MDB_NOTLS,
				 0600);
	return r != 0 ? lmdb_why(why, r, self->path) : 0;
}

/* One transaction: what it writes is in private memory until it is committed. */
static int put_some(struct lmdb *self, int store_fd, size_t from, size_t count, uint8_t *payload)
{
	const struct contest_walk *walk = self->config->walk;
	MDB_txn *transaction;
	int r = mdb_txn_begin(self->environment, NULL, 0, &transaction);

	if (r != 0)
		return r;
	r = mdb_dbi_open(transaction, NULL, MDB_INTEGERKEY | MDB_CREATE, &self->table);
	for (size_t i = from; r == 0 && i < from + count; i++) {
		uint32_t number = walk->node_memory[i];
		const struct store_node *node = &walk->nodes[number];
		MDB_val key = { sizeof(number), &number };
		MDB_val value = { node->payload_bytes, payload };

		if (pread(store_fd, payload, node->payload_bytes, (off_t)node->file_offset) !=
		    (ssize_t)node->payload_bytes)
			r = EIO;
		else
			r = mdb_put(transaction, self->table, &key, &value, MDB_NOOVERWRITE);
		/* A node of several frames. */
		r = r == MDB_KEYEXIST ? 0 : r;
	}
	if (r == 0)
		return mdb_txn_commit(transaction);
	mdb_txn_abort(transaction);
	return r;
}

static int put_all(struct lmdb *self, int store_fd, struct why *why)
{
	const struct contest_walk *walk = self->config->walk;
	uint8_t *payload = malloc(STORE_PAYLOAD_BYTES_MAX);
	int r = payload ? 0 : ENOMEM;

	for (size_t i = 0; r == 0 && i < walk->read_count; i += PUTS_AT_ONCE)
		r = put_some(self, store_fd, i, u64_min(PUTS_AT_ONCE, walk->read_count - i),
			     payload);
	free(payload);
	return r != 0 ? lmdb_why(why, r, "filling") : 0;
}

static int fill(struct lmdb *self, struct why *why)
{
	AUTO_FD fd = open(self->config->walk->store, O_RDONLY | O_CLOEXEC);
	int r;

	if (fd < 0)
		return why_errno(why, -errno, "%s", self->config->walk->store);
	r = environment_open(self, MDB_NOSYNC, why);
	if (r == 0)
		r = put_all(self, fd, why);
	if (self->environment)
		mdb_env_close(self->environment);
	self->environment = NULL;
	return r;
}

static int start(struct lmdb *self, struct why *why)
{
	int r = environment_open(self, MDB_RDONLY | (self->is_larger ? MDB_NORDAHEAD : 0), why);

	if (r < 0)
		return r;
	r = mdb_txn_begin(self->environment, NULL, MDB_RDONLY, &self->transaction);
	if (r == 0)
		r = mdb_dbi_open(self->transaction, NULL, MDB_INTEGERKEY, &self->table);
	if (r != 0)
		return lmdb_why(why, r, "opening");
	mdb_txn_reset(self->transaction);
	return 0;
}

static void stop(struct lmdb *self)
{
	if (self->transaction)
		mdb_txn_abort(self->transaction);
	self->transaction = NULL;
	if (self->environment)
		mdb_env_close(self->environment);
	self->environment = NULL;
}

static void lmdb_close(void *arg)
{
	struct lmdb *self = arg;
	char lock[PATH_MAX + 8];

	stop(self);
	(void)snprintf(lock, sizeof(lock), "%s-lock", self->path);
	(void)unlink(lock);
	(void)unlink(self->path);
	free(self);
}

static int lmdb_open(const struct contest_config *config, void **ret_self, struct why *why)
{
	struct lmdb *self = calloc(1, sizeof(*self));
	int r;

	if (!self)
		return why_set(why, -ENOMEM, "out of memory");
	self->config = config;
	self->is_larger = config->limit_bytes > 0;
	(void)snprintf(self->path, sizeof(self->path), "%s/lmdb-%d", config->scratch, getpid());
	r = fill(self, why);
	if (r == 0)
		r = start(self, why);
	if (r < 0)
		lmdb_close(self);
	else
		*ret_self = self;
	return r;
}

static int lmdb_frame(void *arg, const struct contest_frame *frame,
		      const struct contest_frame *next, struct contest_touch *touch,
		      struct why *why)
{
	struct lmdb *self = arg;
	int r = mdb_txn_renew(self->transaction);

	(void)next;
	for (size_t i = 0; r == 0 && i < frame->node_count; i++) {
		uint32_t number = frame->nodes[i];
		MDB_val key = { sizeof(number), &number };
		MDB_val value;

		r = mdb_get(self->transaction, self->table, &key, &value);
		if (r == 0)
			contest_touch(touch, value.mv_data, value.mv_size);
	}
	mdb_txn_reset(self->transaction);
	return r != 0 ? lmdb_why(why, r, "reading") : 0;
}

static int lmdb_forget(void *arg, struct why *why)
{
	struct lmdb *self = arg;
	AUTO_FD fd = open(self->path, O_RDWR | O_CLOEXEC);

	stop(self);
	if (fd < 0)
		return why_errno(why, -errno, "%s", self->path);
	contest_drop_file(fd);
	return start(self, why);
}

const struct contestant contestant_lmdb = { "LMDB", lmdb_open, lmdb_frame, lmdb_forget,
					    lmdb_close };

#else

static int lmdb_open(const struct contest_config *config, void **ret_self, struct why *why)
{
	(void)config;
	(void)ret_self;
	return why_set(why, -ENOENT, "this oocbench was built without it: install liblmdb-dev");
}

const struct contestant contestant_lmdb = { .name = "LMDB", .open = lmdb_open };

#endif
