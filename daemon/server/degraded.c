/* SPDX-License-Identifier: MIT */
/* What works worse than it could, each with what to do about it. */
#include <errno.h>
#include <stdio.h>
#include <string.h>

#include "daemon/cache/recorder.h"
#include "daemon/limits.h"
#include "daemon/server/server_private.h"
#include "formats/base/bytes.h"

#define HUGE_PAGE_BYTES (2u * MIB)

/* Room for a path and what is said of it. */
struct sentence {
	char text[SERVED_PATH_BYTES + 256];
};

struct teller {
	const struct server *server;
	bool (*sees)(const void *arg, const struct served *served);
	degraded_fn tell;
	void *arg;
};

#define TELL(teller, ...)                                                                          \
	do {                                                                                       \
		struct sentence sentence_;                                                         \
		(void)snprintf(sentence_.text, sizeof(sentence_.text), __VA_ARGS__);               \
		(teller)->tell((teller)->arg, sentence_.text);                                     \
	} while (0)

static void tell_reading(const struct teller *teller)
{
	const struct server *server = teller->server;

	if (fetch_degraded(server->fetch)[0] != '\0')
		teller->tell(teller->arg, fetch_degraded(server->fetch));
	if (server->buffer_error < 0)
		TELL(teller,
		     "memory cannot be registered for reading (%s): reads cost more processor "
		     "time: raise LimitMEMLOCK or `ulimit -l`",
		     strerror(-server->buffer_error));
	if (server->config.disk)
		TELL(teller, "reads are slowed down on purpose (--disk %s): leave it out",
		     server->config.disk->name);
}

static void tell_memory(const struct teller *teller)
{
	const struct server *server = teller->server;
	uint64_t pinned_bytes = residents_bytes(&server->residents);
	uint64_t share_bytes = server->cache.budget_wanted_bytes / RESIDENT_SHARE;

	if (server->cache.short_since_ns > 0)
		TELL(teller, "memory is short: the cache is smaller than asked for: lower "
			     "--cache-size or give oocd more memory");
	if (pinned_bytes > share_bytes)
		TELL(teller,
		     "%llu MiB are pinned, 1/%u of the cache is %llu MiB: clients have less than "
		     "half: `oocctl unpin` some, or raise --cache-size",
		     (unsigned long long)(pinned_bytes / MIB), RESIDENT_SHARE,
		     (unsigned long long)(share_bytes / MIB));
	if (server->accept_error < 0)
		TELL(teller,
		     "clients cannot be accepted (%s): raise LimitNOFILE or `ulimit -n`, or give "
		     "oocd more memory",
		     strerror(-server->accept_error));
}

static void tell_records(const struct teller *teller)
{
	const struct server *server = teller->server;
	int trace_error = recorder_error(server->cache.recorder);

	if (trace_error < 0)
		TELL(teller,
		     "the trace has ended (%s): make room, or write it to a faster disk, and "
		     "restart oocd to begin another",
		     trace_error == -EAGAIN ? "its disk cannot keep up" : strerror(-trace_error));
	if (server->metrics.error < 0)
		TELL(teller,
		     "the file of metrics cannot be written (%s): see that oocd may write to the "
		     "folder of metrics-file",
		     strerror(-server->metrics.error));
}

static void tell_restart(const struct teller *teller)
{
	if (!handover_is_possible())
		TELL(teller,
		     "no descriptor store: after a restart the cache is cold: run oocd as its "
		     "unit, with FileDescriptorStoreMax=");
}

static void tell_store(const struct teller *teller, const struct served *served)
{
	if (!served->direct)
		TELL(teller,
		     "%s: no direct reads, its bytes lie in the page cache too: keep it on a file "
		     "system with O_DIRECT",
		     served->path);
	if (served->counters.errors > 0)
		TELL(teller,
		     "%s: %llu reads failed or gave damaged payloads: `oocctl verify` names them; "
		     "build it again, or restore a copy",
		     served->path, (unsigned long long)served->counters.errors);
	if (served->counters.fragmented > 0)
		TELL(teller,
		     "%s: %llu reads found no place though enough was free in smaller pieces: "
		     "raise --cache-size",
		     served->path, (unsigned long long)served->counters.fragmented);
}

static void tell_huge_pages(const struct teller *teller)
{
	uint64_t could_bytes = 0;
	uint64_t huge_bytes = 0;

	LIST_FOR_EACH (link, &teller->server->cache.stores) {
		const struct served *served = LIST_ENTRY(link, struct served, link);

		if (served->arena.segment_bytes >= HUGE_PAGE_BYTES)
			could_bytes += arena_bytes(&served->arena);
		huge_bytes += arena_huge_bytes(&served->arena);
	}
	if (huge_bytes < could_bytes)
		TELL(teller,
		     "huge pages: %llu of %llu MiB: memory is fragmented, or the kernel is older "
		     "than 6.1 and /sys/kernel/mm/transparent_hugepage/shmem_enabled is not advise",
		     (unsigned long long)(huge_bytes / MIB),
		     (unsigned long long)(could_bytes / MIB));
}

static void tell_peers(const struct teller *teller)
{
	LIST_FOR_EACH (link, &teller->server->sessions) {
		if (connection_knows_peer(LIST_ENTRY(link, struct session, link)->connection))
			continue;
		TELL(teller, "this kernel does not say for sure which process a client is: the "
			     "death of one whose child keeps the socket may be missed: run Linux "
			     "6.5 or newer");
		return;
	}
}

void server_degraded(const struct server *server,
		     bool (*sees)(const void *arg, const struct served *served), degraded_fn tell,
		     void *arg)
{
	struct teller teller = { server, sees, tell, arg };

	tell_reading(&teller);
	tell_memory(&teller);
	tell_records(&teller);
	tell_restart(&teller);
	tell_peers(&teller);
	LIST_FOR_EACH (link, &server->cache.stores) {
		const struct served *served = LIST_ENTRY(link, struct served, link);

		if (sees(arg, served))
			tell_store(&teller, served);
	}
	tell_huge_pages(&teller);
}
