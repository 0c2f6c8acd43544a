/* SPDX-License-Identifier: MIT */
#include "daemon/restart/handover.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <systemd/sd-daemon.h>

#include "formats/base/bytes.h"
#include "formats/base/file.h"
#include "formats/base/text.h"

#define NAME_BYTES 96
/* Every name of ours begins so; what follows the key says what it is. */
#define NAME_BEGINS "oocd-"

/* ---- names ---- */

static void name_of_part(char name[NAME_BYTES], uint64_t key, const char *part)
{
	(void)snprintf(name, NAME_BYTES, NAME_BEGINS "%016" PRIx64 "-%s", key, part);
}

static void name_of_directory(char name[NAME_BYTES], uint64_t key, uint64_t epoch)
{
	(void)snprintf(name, NAME_BYTES, NAME_BEGINS "%016" PRIx64 "-directory-%016" PRIx64, key,
		       epoch);
}

static void name_of_segment(char name[NAME_BYTES], uint64_t key, uint32_t number, uint32_t huge_mib)
{
	(void)snprintf(name, NAME_BYTES, NAME_BEGINS "%016" PRIx64 "-segment-%u-%u", key, number,
		       huge_mib);
}

static void name_of_segment_of(char name[NAME_BYTES], const struct served *served,
			       const struct segment *segment)
{
	name_of_segment(name, served->key, segment->number,
			(uint32_t)(segment->memfile.huge_bytes / MIB));
}

/* ---- to the service manager ---- */

static void keep(const char *name, int fd)
{
	char message[NAME_BYTES + 32];

	(void)snprintf(message, sizeof(message), "FDSTORE=1\nFDNAME=%s", name);
	(void)sd_pid_notify_with_fds(0, 0, message, &fd, 1);
}

static void forget(const char *name)
{
	(void)sd_notifyf(0, "FDSTOREREMOVE=1\nFDNAME=%s", name);
}

bool handover_is_possible(void)
{
	/* Managers of version 254 and later say how many descriptors they take. */
	const char *store = getenv("FDSTORE");
	uint64_t count;

	return getenv("NOTIFY_SOCKET") &&
	       (!store || (text_to_u64(store, &count) == 0 && count > 0));
}

void handover_keep_store(const struct served *served)
{
	char name[NAME_BYTES];

	name_of_part(name, served->key, "file");
	keep(name, served->fd);
	name_of_part(name, served->key, "ledger");
	keep(name, served->ledger.file.fd);
}

void handover_keep_directory(const struct served *served, uint64_t epoch)
{
	char name[NAME_BYTES];

	name_of_directory(name, served->key, epoch);
	keep(name, served->directory_file.fd);
}

void handover_keep_segment(const struct served *served, const struct segment *segment)
{
	char name[NAME_BYTES];

	name_of_segment_of(name, served, segment);
	keep(name, segment->memfile.fd);
}

void handover_forget_segment(const struct served *served, const struct segment *segment)
{
	char name[NAME_BYTES];

	name_of_segment_of(name, served, segment);
	forget(name);
}

void handover_forget_directory(const struct served *served, uint64_t epoch)
{
	char name[NAME_BYTES];

	name_of_directory(name, served->key, epoch);
	forget(name);
}

void handover_forget_store(const struct served *served)
{
	char name[NAME_BYTES];

	name_of_part(name, served->key, "file");
	forget(name);
	name_of_part(name, served->key, "ledger");
	forget(name);
}

/* ---- from a predecessor ---- */

static struct kept_store *kept_find(struct list *stores, uint64_t key)
{
	struct kept_store *kept;

	LIST_FOR_EACH (link, stores) {
		kept = LIST_ENTRY(link, struct kept_store, link);
		if (kept->key == key)
			return kept;
	}
	kept = calloc(1, sizeof(*kept));
	if (!kept)
		return NULL;
	kept->key = key;
	kept->file_fd = -1;
	kept->ledger_fd = -1;
	list_push_back(stores, &kept->link);
	return kept;
}

static bool take_directory(struct kept_store *kept, uint64_t epoch, int fd)
{
	uint32_t at = kept->directory_count;

	if (at == KEPT_DIRECTORY_MAX)
		return false;
	for (; at > 0 && kept->directories[at - 1].epoch < epoch; at--)
		kept->directories[at] = kept->directories[at - 1];
	kept->directories[at] = (struct kept_directory){ epoch, fd };
	kept->directory_count++;
	return true;
}

/* part: of the name, behind the key.  Returns: was fd taken? */
static bool take_part(struct kept_store *kept, const char *part, int fd)
{
	int *single = strcmp(part, "file") == 0     ? &kept->file_fd
		      : strcmp(part, "ledger") == 0 ? &kept->ledger_fd
						    : NULL;
	struct kept_segment segment = { .fd = fd };
	uint64_t epoch;

	if (single && *single < 0) {
		*single = fd;
		return true;
	}
	if (sscanf(part, "directory-%" SCNx64, &epoch) == 1)
		return take_directory(kept, epoch, fd);
	if (sscanf(part, "segment-%u-%u", &segment.number, &segment.huge_mib) == 2 &&
	    segment.number < WIRE_SEGMENT_COUNT_MAX &&
	    kept->segment_count < WIRE_SEGMENT_COUNT_MAX) {
		kept->segments[kept->segment_count++] = segment;
		return true;
	}
	return false;
}

/* Returns: was fd taken? */
static bool take_named(struct list *stores, const char *name, int fd)
{
	struct kept_store *kept;
	uint64_t key;
	int part_at = 0;

	if (sscanf(name, NAME_BEGINS "%16" SCNx64 "-%n", &key, &part_at) != 1 || part_at == 0)
		return false;
	kept = kept_find(stores, key);
	return kept && take_part(kept, name + part_at, fd);
}

void handover_collect(struct list *ret_stores, int *ret_socket_fd)
{
	char **names = NULL;
	int count = sd_listen_fds_with_names(1, &names);

	list_init(ret_stores);
	*ret_socket_fd = -1;
	for (int i = 0; i < count; i++) {
		int fd = SD_LISTEN_FDS_START + i;

		if (*ret_socket_fd < 0 && sd_is_socket(fd, AF_UNIX, SOCK_SEQPACKET, 1) > 0)
			*ret_socket_fd = fd;
		else if (!take_named(ret_stores, names[i], fd)) {
			if (strncmp(names[i], NAME_BEGINS, strlen(NAME_BEGINS)) == 0)
				forget(names[i]);
			(void)fd_close(fd);
		}
	}
	for (int i = 0; i < count; i++)
		free(names[i]);
	free(names);
}

/* fd: -1: somebody has taken it, and its name with it. */
static void drop(int fd, const char *name, bool forgotten)
{
	if (fd < 0)
		return;
	if (forgotten)
		forget(name);
	(void)fd_close(fd);
}

struct kept_store *kept_store_destroy(struct kept_store *kept, bool forgotten)
{
	char name[NAME_BYTES];

	if (!kept)
		return NULL;
	name_of_part(name, kept->key, "file");
	drop(kept->file_fd, name, forgotten);
	name_of_part(name, kept->key, "ledger");
	drop(kept->ledger_fd, name, forgotten);
	for (uint32_t i = 0; i < kept->directory_count; i++) {
		name_of_directory(name, kept->key, kept->directories[i].epoch);
		drop(kept->directories[i].fd, name, forgotten);
	}
	for (uint32_t i = 0; i < kept->segment_count; i++) {
		name_of_segment(name, kept->key, kept->segments[i].number,
				kept->segments[i].huge_mib);
		drop(kept->segments[i].fd, name, forgotten);
	}
	list_remove(&kept->link);
	free(kept);
	return NULL;
}
