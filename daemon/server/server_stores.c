/* SPDX-License-Identifier: MIT */
/* Opening and closing stores, making and losing segments: what workers do for the server. */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

#include "daemon/cache/recorder.h"
#include "daemon/limits.h"
#include "daemon/server/server_private.h"
#include "formats/base/check.h"
#include "formats/base/clock.h"
#include "formats/base/file.h"
#include "formats/base/log.h"

/* OPENs that may be with the workers at one time: each may load a whole HS. */
#define OPENING_COUNT_MAX 64u

/* Linux 5.14; older headers do not have it. */
#ifndef MADV_POPULATE_WRITE
#define MADV_POPULATE_WRITE 23
#endif

static struct served *store_find(struct server *server, dev_t device, ino_t inode)
{
	/* From the newest: an older generation of the same file may still be in use. */
	for (struct list *link = server->cache.stores.prev; link != &server->cache.stores;
	     link = link->prev) {
		struct served *served = LIST_ENTRY(link, struct served, link);

		if (served->device == device && served->inode == inode)
			return served;
	}
	return NULL;
}

static void store_close_served(struct server *server, struct served *served)
{
	cache_remove_store(&server->cache, served);
	recorder_close(served);
	store_counters_add(&server->closed_counters, &served->counters);
	handover_forget_directory(served, server->epoch);
	handover_forget_store(served);
	fetch_remove_file(server->fetch, served->file);
	served_close(served);
}

static bool store_is_idle(const struct served *served)
{
	return served->attach_count == 0 && served->pinned_pages == 0 && !served->segment_coming &&
	       !served->keep && served->resident_count == 0 && !served->inherited;
}

/* Room in the table of stores, if need be by closing the one that has been idle for the longest. */
static int store_make_room(struct server *server, struct why *why)
{
	struct served *oldest = NULL;

	if (server->cache.store_count < SERVED_COUNT_MAX)
		return 0;
	LIST_FOR_EACH (link, &server->cache.stores) {
		struct served *served = LIST_ENTRY(link, struct served, link);

		if (store_is_idle(served) &&
		    (!oldest || served->idle_since_ns < oldest->idle_since_ns))
			oldest = served;
	}
	if (!oldest)
		return why_set(why, -EMFILE, "%u stores are in use: close one", SERVED_COUNT_MAX);
	store_close_served(server, oldest);
	return 0;
}

/* Makes an opened store known to cache and fetch layer.  On failure it is closed. */
static int store_install(struct server *server, struct served *served, struct why *why)
{
	int r = store_make_room(server, why);

	if (r == 0)
		r = fills_prepare(server->fills, served, why);
	if (r == 0) {
		r = fetch_add_file(server->fetch, served->fd, &served->file);
		if (r < 0)
			why_errno(why, r, "the store's descriptor");
	}
	if (r == 0) {
		r = replacement_create(server->config.replacement, served->node_count,
				       &served->replacement);
		if (r < 0) {
			fetch_remove_file(server->fetch, served->file);
			why_errno(why, r, "the order of %u nodes", served->node_count);
		}
	}
	if (r < 0) {
		served_close(served);
		return r;
	}
	if (!served->direct)
		log_warning(
			"%s: its file system has no direct reads: they go through the page cache",
			served->path);
	cache_add_store(&server->cache, served);
	recorder_open(server->cache.recorder, served);
	return 0;
}

static int store_install_new(struct server *server, struct served *served, struct why *why)
{
	int r = store_install(server, served, why);

	if (r < 0)
		return r;
	handover_keep_store(served);
	handover_keep_directory(served, server->epoch);
	cache_warm_up(&server->cache, served);
	return 0;
}

/*
 * Opens a named store's file.  *ret_known is the store when it is open already: the same store twice
 * is once.
 */
static int open_named(struct server *server, const char *path, int *ret_fd,
		      struct served **ret_known, struct why *why)
{
	dev_t device;
	ino_t inode;
	int fd = open(path, O_RDONLY | O_CLOEXEC | O_NOCTTY | O_NONBLOCK);
	int r;

	if (fd < 0)
		return why_errno(why, -errno, "%s", path);
	r = served_identify(fd, &device, &inode, why);
	if (r < 0) {
		(void)fd_close(fd);
		why_prefix(why, "%s", path);
		return r;
	}
	*ret_fd = fd;
	*ret_known = store_find(server, device, inode);
	return 0;
}

int server_open_store(struct server *server, const char *path, struct why *why)
{
	struct served *served;
	int fd;
	int r;

	r = open_named(server, path, &fd, &served, why);
	if (r < 0)
		return r;
	if (served) {
		served->keep = true;
		(void)fd_close(fd);
		return 0;
	}
	r = served_open(fd, path, server->config.cache_bytes, server->epoch, &served, why);
	if (r == 0) {
		served->keep = true;
		r = store_install_new(server, served, why);
	}
	if (r < 0)
		why_prefix(why, "%s", path);
	return r;
}

/* ---- OPEN of a client ---- */

struct open_job {
	struct worker_job job;
	struct server *server;
	uint32_t session; /* 0: nobody's; the configuration names the store */
	uint32_t slot;
	uint32_t ticket;
	int fd;
	char path[SERVED_PATH_BYTES];
	struct served *known;  /* attached to for as long as the job lasts; NULL: none */
	struct served *opened; /* by run() */
	bool current;          /* known is what the file is now */
	uint8_t uuid[16];      /* of known */
	uint64_t generation;
	int error;
	struct why why;
};

/* On a worker. */
static void open_run(struct worker_job *job, struct codec_scratch *scratch)
{
	struct open_job *self = LIST_ENTRY(job, struct open_job, job);

	(void)scratch;
	if (self->known && served_is_current(self->fd, self->uuid, self->generation)) {
		self->current = true;
		self->fd = fd_close(self->fd);
		return;
	}
	self->error = served_open(self->fd, self->path, self->server->config.cache_bytes,
				  self->server->epoch, &self->opened, &self->why);
	self->fd = -1;
}

/* The store that the job found: the one known, the one opened, or one opened by a job like it. */
static struct served *open_result(struct open_job *self)
{
	struct served *twin;

	if (self->current)
		return self->known;
	twin = store_find(self->server, self->opened->device, self->opened->inode);
	if (twin && twin->superblock->generation == self->opened->superblock->generation &&
	    memcmp(twin->superblock->uuid, self->opened->superblock->uuid,
		   sizeof(twin->superblock->uuid)) == 0) {
		served_close(self->opened);
		return twin;
	}
	self->error = store_install_new(self->server, self->opened, &self->why);
	return self->error < 0 ? NULL : self->opened;
}

static struct session *session_find(struct server *server, uint32_t number)
{
	LIST_FOR_EACH (link, &server->sessions) {
		struct session *session = LIST_ENTRY(link, struct session, link);

		if (session->number == number)
			return session;
	}
	return NULL;
}

static void open_done(struct worker_job *job)
{
	struct open_job *self = LIST_ENTRY(job, struct open_job, job);
	struct session *session = session_find(self->server, self->session);
	struct served *served = NULL;

	self->server->opening_count--;
	if (self->error == 0)
		served = open_result(self);
	if (session && served)
		session_opened(session, self->slot, self->ticket, served);
	else if (session)
		session_refuse(session, self->slot, self->ticket, self->error, &self->why);
	else if (self->session == 0 && served)
		served->keep = true;
	else if (self->session == 0)
		log_error("%s: %s; the other stores are served", self->path, self->why.text);
	if (self->known)
		self->known->attach_count--;
	server_active(self->server);
	free(self);
}

/*
 * Starts to open a store on a worker.  known: that the file is of, as far as device and inode say;
 * NULL: none.  Returns: 0; or -ENOMEM or -EAGAIN, after which fd is still the caller's.
 */
static int open_start(struct server *server, int fd, const char *path, struct served *known,
		      const struct open_job *asked, struct why *why)
{
	struct open_job *job;

	if (server->opening_count == OPENING_COUNT_MAX)
		return why_set(why, -EAGAIN, "too many stores are being opened: try again");
	job = calloc(1, sizeof(*job));
	if (!job)
		return why_errno(why, -ENOMEM, "opening a store");
	*job = *asked;
	job->job = (struct worker_job){ .run = open_run, .done = open_done };
	list_init(&job->job.link);
	job->server = server;
	job->fd = fd;
	(void)snprintf(job->path, sizeof(job->path), "%s", path);
	job->known = known;
	if (known) {
		known->attach_count++;
		memcpy(job->uuid, known->superblock->uuid, sizeof(job->uuid));
		job->generation = known->superblock->generation;
	}
	server->opening_count++;
	workers_add(server->workers, &job->job);
	return 0;
}

void server_open(struct server *server, struct session *session, uint32_t slot, uint32_t ticket,
		 int fd, const char *path)
{
	const struct open_job asked = {
		.session = session->number,
		.slot = slot,
		.ticket = ticket,
	};
	struct why why;
	dev_t device;
	ino_t inode;
	int r = served_identify(fd, &device, &inode, &why);

	if (r == 0)
		r = open_start(server, fd, path, store_find(server, device, inode), &asked, &why);
	if (r < 0) {
		(void)fd_close(fd);
		session_refuse(session, slot, ticket, r, &why);
	}
}

int server_want_store(struct server *server, const char *path, struct why *why)
{
	const struct open_job asked = { .session = 0 };
	struct served *known;
	int fd;
	int r;

	r = open_named(server, path, &fd, &known, why);
	if (r < 0)
		return r;
	r = open_start(server, fd, path, known, &asked, why);
	if (r < 0) {
		(void)fd_close(fd);
		why_prefix(why, "%s", path);
	}
	return r;
}

void server_close_idle(struct server *server, uint64_t now_ns)
{
	uint64_t idle_ns = server->config.idle_close_s * NS_PER_S;

	LIST_FOR_EACH (link, &server->cache.stores) {
		struct served *served = LIST_ENTRY(link, struct served, link);

		if (served->attach_count > 0)
			served->idle_since_ns = 0;
		else if (served->idle_since_ns == 0)
			served->idle_since_ns = now_ns;
		else if (store_is_idle(served) && now_ns - served->idle_since_ns > idle_ns)
			store_close_served(server, served);
	}
}

void server_close_stores(struct server *server)
{
	/* Not evicted: clients that live on draw what is there. */
	LIST_FOR_EACH (link, &server->cache.stores) {
		struct served *served = LIST_ENTRY(link, struct served, link);

		takeover_forget(served);
		list_remove(link);
		recorder_close(served);
		served_close(served);
	}
}

/* ---- segments ---- */

struct segment_job {
	struct worker_job job;
	struct server *server;
	struct served *served;
	uint64_t bytes;
	struct memfile memfile;
	int error;
	struct why why;
};

/* On a worker. */
static void segment_run(struct worker_job *job, struct codec_scratch *scratch)
{
	struct segment_job *self = LIST_ENTRY(job, struct segment_job, job);

	(void)scratch;
	self->error = memfile_create("oocd-segment", self->bytes, true, &self->memfile, &self->why);
	if (self->error == 0)
		self->error = memfile_publish(&self->memfile, MEMFILE_CHANGING, &self->why);
	if (self->error < 0)
		memfile_done(&self->memfile);
}

/* Where the memory cannot be registered, plain reads do; the status says so. */
static void segment_register(struct server *server, struct segment *segment)
{
	int r = fetch_add_buffer(server->fetch, segment->memfile.base, segment->memfile.bytes,
				 &segment->buffer);

	if (r == 0)
		return;
	segment->buffer = FETCH_BUFFER_NONE;
	if (r != -EOPNOTSUPP)
		server->buffer_error = r;
}

static void segment_done(struct worker_job *job)
{
	struct segment_job *self = LIST_ENTRY(job, struct segment_job, job);
	struct server *server = self->server;
	struct served *served = self->served;
	struct segment *segment;

	if (self->error < 0) {
		log_error("%s; the cache stays as large as it is for now", self->why.text);
		cache_segment_failed(&server->cache, served);
	} else if (cache_add_segment(&server->cache, served, &self->memfile, &segment) < 0) {
		log_error("no memory for a segment's table");
		memfile_done(&self->memfile);
	} else {
		segment_register(server, segment);
		handover_keep_segment(served, segment);
		LIST_FOR_EACH (link, &server->sessions)
			session_tell_segment(LIST_ENTRY(link, struct session, link), served,
					     segment);
	}
	server_active(server);
	free(self);
}

void server_make_segment(void *arg, struct served *served)
{
	struct server *server = arg;
	struct segment_job *self = calloc(1, sizeof(*self));

	if (!self) {
		cache_segment_failed(&server->cache, served);
		return;
	}
	self->job = (struct worker_job){ .run = segment_run, .done = segment_done };
	list_init(&self->job.link);
	self->server = server;
	self->served = served;
	self->bytes = served->arena.segment_bytes;
	self->memfile = MEMFILE_NONE;
	workers_add_first(server->workers, &self->job);
}

void server_segment_gone(void *arg, struct served *served, struct segment *segment)
{
	struct server *server = arg;

	/* First of all: reads into punched memory would succeed and be lost. */
	fetch_remove_buffer(server->fetch, segment->buffer);
	handover_forget_segment(served, segment);
	LIST_FOR_EACH (link, &server->sessions)
		session_tell_segment_gone(LIST_ENTRY(link, struct session, link), served,
					  segment->number);
}

/* ---- what a predecessor left ---- */

/*
 * Registering memory maps it first, which takes up to a second a GiB: that is a worker's, one segment
 * after the other.  To register takes half as long again, and is the loop's.  Neither begins before
 * all is verified, which clients wait for; until then segments are read into as memory that cannot be
 * registered.
 */
struct map_job {
	struct worker_job job;
	struct server *server;
	const struct served *served; /* it may have gone when the job is done */
	uint32_t number;
	void *base;
	uint64_t bytes;
};

/* On a worker.  If the segment goes meanwhile, there is nothing to map, or nobody minds. */
static void map_run(struct worker_job *job, struct codec_scratch *scratch)
{
	struct map_job *self = LIST_ENTRY(job, struct map_job, job);

	(void)scratch;
	(void)madvise(self->base, self->bytes, MADV_POPULATE_WRITE);
}

static struct segment *map_result(const struct map_job *self)
{
	LIST_FOR_EACH (link, &self->server->cache.stores) {
		const struct served *served = LIST_ENTRY(link, struct served, link);
		struct segment *segment = served->arena.by_number[self->number];

		if (served == self->served && segment && segment->memfile.base == self->base)
			return segment;
	}
	return NULL;
}

static void map_next(struct server *server);

static void map_done(struct worker_job *job)
{
	struct map_job *self = LIST_ENTRY(job, struct map_job, job);
	struct server *server = self->server;
	struct segment *segment = map_result(self);

	free(self);
	if (server->stopping)
		return;
	if (segment)
		segment_register(server, segment);
	map_next(server);
}

static void map_start(struct server *server, const struct served *served, struct segment *segment)
{
	struct map_job *self = calloc(1, sizeof(*self));

	segment->inherited = false;
	/* Without memory for the job it stays unregistered. */
	if (!self)
		return;
	self->job = (struct worker_job){ .run = map_run, .done = map_done };
	list_init(&self->job.link);
	self->server = server;
	self->served = served;
	self->number = segment->number;
	self->base = segment->memfile.base;
	self->bytes = segment->memfile.bytes;
	workers_add(server->workers, &self->job);
}

static void map_next(struct server *server)
{
	LIST_FOR_EACH (link, &server->cache.stores) {
		const struct served *served = LIST_ENTRY(link, struct served, link);

		LIST_FOR_EACH (at, &served->arena.in_order) {
			if (!ARENA_SEGMENT(at)->inherited)
				continue;
			map_start(server, served, ARENA_SEGMENT(at));
			return;
		}
	}
}

/* A description of the file that is read from as any other, whatever the predecessor read by. */
static int reopen_kept(const struct kept_store *kept, struct why *why)
{
	int fd = fcntl(kept->file_fd, F_DUPFD_CLOEXEC, 3);
	int flags = fd < 0 ? -1 : fcntl(fd, F_GETFL);

	if (flags < 0 || fcntl(fd, F_SETFL, flags & ~O_DIRECT) < 0) {
		int r = why_errno(why, -errno, "its descriptor");

		(void)fd_close(fd);
		return r;
	}
	return fd;
}

/* Opens the file anew and makes it the heir of the ledger.  Its memory is not looked at yet. */
static int open_kept(struct server *server, const struct kept_store *kept, struct ledger *ledger,
		     struct served **ret, struct why *why)
{
	struct served *served;
	int fd = reopen_kept(kept, why);
	int r;

	if (fd < 0)
		return fd;
	r = served_open(fd, ledger->header->path, server->config.cache_bytes, server->epoch,
			&served, why);
	if (r < 0)
		return r;
	r = served_inherit(served, ledger, kept->key, server->config.cache_bytes, why);
	if (r < 0) {
		served_close(served);
		return r;
	}
	*ret = served;
	return store_install(server, served, why);
}

static int take_over_store(struct server *server, struct kept_store *kept, struct why *why)
{
	struct ledger ledger = LEDGER_NONE;
	struct served *served;
	int r;

	if (kept->file_fd < 0 || kept->ledger_fd < 0)
		return why_set(why, -EUCLEAN, "not all of it is there");
	r = ledger_adopt(fcntl(kept->ledger_fd, F_DUPFD_CLOEXEC, 3), &ledger, why);
	if (r < 0)
		return r;
	r = open_kept(server, kept, &ledger, &served, why);
	ledger_done(&ledger);
	if (r < 0)
		return r;
	kept->file_fd = fd_close(kept->file_fd);
	kept->ledger_fd = fd_close(kept->ledger_fd);
	if (takeover_begin(server->takeover, served, kept,
			   clock_now_ns() + server->config.grace_ms * NS_PER_MS) < 0)
		log_warning("%s: no memory to take over what is kept of it", served->path);
	/* Only now: a successor finds every kept payload in the newest directory. */
	handover_keep_directory(served, server->epoch);
	return 0;
}

void server_take_over(struct server *server)
{
	struct list *kept_stores = server->config.kept_stores;

	if (!kept_stores)
		return;
	LIST_FOR_EACH (link, kept_stores) {
		struct kept_store *kept = LIST_ENTRY(link, struct kept_store, link);
		struct why why;

		if (take_over_store(server, kept, &why) < 0)
			log_info("what is kept of a store is not taken over: %s", why.text);
		kept_store_destroy(kept, true);
	}
	server->config.kept_stores = NULL;
	server->to_map = true;
}

void server_map_inherited(struct server *server)
{
	struct takeover_counts counts;

	if (!server->to_map)
		return;
	takeover_count(server->takeover, &counts);
	if (counts.left > 0)
		return;
	server->to_map = false;
	map_next(server);
}
