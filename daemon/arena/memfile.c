/* SPDX-License-Identifier: MIT */
#include "daemon/arena/memfile.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/falloc.h>
#include <stdio.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include "formats/base/bytes.h"
#include "formats/base/clock.h"
#include "formats/base/file.h"

/* Linux 6.1; the headers of Debian 12 do not have it. */
#ifndef MADV_COLLAPSE
#define MADV_COLLAPSE 25
#endif

#define MEMFILE_PAGE_BYTES 4096u
#define MEMFILE_HUGE_BYTES (2u * MIB)
/* Processor time that a 2 MiB page may cost; 0.25 ms is usual. */
#define COLLAPSE_NS_MAX NS_PER_MS

/* Maps at an address that 2 MiB pages can be used at: reserve more, cut what sticks out. */
static void *map_aligned(int fd, uint64_t bytes)
{
	uint64_t reserved_bytes = bytes + MEMFILE_HUGE_BYTES;
	uint8_t *reserved = mmap(NULL, reserved_bytes, PROT_NONE,
				 MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
	uint8_t *base;
	uint64_t head_bytes;

	if (reserved == MAP_FAILED)
		return MAP_FAILED;
	head_bytes = bytes_round_up((uintptr_t)reserved, MEMFILE_HUGE_BYTES) - (uintptr_t)reserved;
	base = mmap(reserved + head_bytes, bytes, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_FIXED,
		    fd, 0);
	if (base == MAP_FAILED) {
		(void)munmap(reserved, reserved_bytes);
		return MAP_FAILED;
	}
	if (head_bytes > 0)
		(void)munmap(reserved, head_bytes);
	if (reserved_bytes > head_bytes + bytes)
		(void)munmap(base + bytes, reserved_bytes - head_bytes - bytes);
	return base;
}

/*
 * MADV_COLLAPSE works although shmem_enabled is "never", where MADV_HUGEPAGE silently does nothing.
 * It refuses a chunk without any page, and copies those that there are: one page a chunk is the
 * cheapest (0.13 s a GiB; populated first, 0.5 to 2.8 s).  Chunk by chunk, so that one that fails does
 * not cost the rest, and what was got is known.  Where the kernel has to move other memory out of the
 * way first, which costs seconds a GiB, small pages for the rest are the better bargain.
 */
static uint64_t collapse(int fd, uint8_t *base, uint64_t bytes)
{
	uint64_t end_ns = clock_spent_ns() + bytes / MEMFILE_HUGE_BYTES * COLLAPSE_NS_MAX;
	uint64_t huge_bytes = 0;

	for (uint64_t at = 0; at + MEMFILE_HUGE_BYTES <= bytes; at += MEMFILE_HUGE_BYTES) {
		if (clock_spent_ns() > end_ns)
			break;
		if (fallocate(fd, 0, (off_t)at, MEMFILE_PAGE_BYTES) == 0 &&
		    madvise(base + at, MEMFILE_HUGE_BYTES, MADV_COLLAPSE) == 0)
			huge_bytes += MEMFILE_HUGE_BYTES;
	}
	return huge_bytes;
}

int memfile_create(const char *name, uint64_t bytes, bool huge, struct memfile *ret,
		   struct why *why)
{
	struct memfile memfile = MEMFILE_NONE;
	int r;

	*ret = MEMFILE_NONE;
	memfile.bytes = bytes_round_up(bytes, MEMFILE_PAGE_BYTES);
	memfile.fd = memfd_create(name, MFD_CLOEXEC | MFD_ALLOW_SEALING);
	if (memfile.fd < 0)
		return why_errno(why, -errno, "memory file %s", name);
	if (ftruncate(memfile.fd, (off_t)memfile.bytes) < 0) {
		r = why_errno(why, -errno, "memory file %s", name);
		goto err_done;
	}
	memfile.base = map_aligned(memfile.fd, memfile.bytes);
	if (memfile.base == MAP_FAILED) {
		memfile.base = NULL;
		r = why_errno(why, -errno, "mapping %s", name);
		goto err_done;
	}
	if (huge)
		memfile.huge_bytes = collapse(memfile.fd, memfile.base, memfile.bytes);
	/* The rest, so that there is no hole left for a client to fill at its own expense. */
	if (fallocate(memfile.fd, 0, 0, (off_t)memfile.bytes) < 0) {
		r = why_errno(why, -errno, "%llu bytes of shared memory for %s",
			      (unsigned long long)memfile.bytes, name);
		goto err_done;
	}
	*ret = memfile;
	return 0;

err_done:
	memfile_done(&memfile);
	return r;
}

/* A writable map forbids F_SEAL_WRITE, so the map is made anew. */
static int remap_read_only(struct memfile *memfile)
{
	(void)munmap(memfile->base, memfile->bytes);
	memfile->base = NULL;
	if (fcntl(memfile->fd, F_ADD_SEALS, F_SEAL_WRITE) < 0)
		return -errno;
	memfile->base = mmap(NULL, memfile->bytes, PROT_READ, MAP_SHARED, memfile->fd, 0);
	if (memfile->base == MAP_FAILED) {
		memfile->base = NULL;
		return -errno;
	}
	return 0;
}

static int open_for_reading(struct memfile *memfile, struct why *why)
{
	char path[32];

	(void)snprintf(path, sizeof(path), "/proc/self/fd/%d", memfile->fd);
	memfile->read_fd = open(path, O_RDONLY | O_CLOEXEC);
	if (memfile->read_fd < 0)
		return why_errno(why, -errno,
				 "opening shared memory for reading (is /proc mounted?)");
	return 0;
}

int memfile_publish(struct memfile *memfile, enum memfile_content content, struct why *why)
{
	if (content == MEMFILE_FIXED) {
		int r = remap_read_only(memfile);

		if (r < 0)
			return why_errno(why, r, "sealing shared memory");
	}
	if (fcntl(memfile->fd, F_ADD_SEALS, F_SEAL_GROW | F_SEAL_SHRINK | F_SEAL_SEAL) < 0)
		return why_errno(why, -errno, "sealing shared memory");
	if (fchmod(memfile->fd, 0400) < 0)
		return why_errno(why, -errno, "protecting shared memory");
	return open_for_reading(memfile, why);
}

/* A hole would be filled by the first client that touches it, at its expense. */
static int judge_adopted(int fd, uint64_t *ret_bytes, struct why *why)
{
	const int sealed = F_SEAL_GROW | F_SEAL_SHRINK | F_SEAL_SEAL;
	struct stat status;
	int seals = fcntl(fd, F_GET_SEALS);
	int flags = fcntl(fd, F_GETFL);

	if (seals < 0 || flags < 0 || fstat(fd, &status) < 0)
		return why_errno(why, -errno, "kept memory");
	if ((seals & sealed) != sealed || (seals & F_SEAL_WRITE) != 0 ||
	    (flags & O_ACCMODE) != O_RDWR || status.st_size <= 0 ||
	    status.st_size % MEMFILE_PAGE_BYTES != 0 ||
	    (uint64_t)status.st_blocks * 512 < (uint64_t)status.st_size)
		return why_set(why, -EUCLEAN, "kept memory is not as it was left");
	*ret_bytes = (uint64_t)status.st_size;
	return 0;
}

int memfile_adopt(int fd, struct memfile *ret, struct why *why)
{
	struct memfile memfile = { .fd = fd, .read_fd = -1 };
	int r;

	*ret = MEMFILE_NONE;
	r = judge_adopted(fd, &memfile.bytes, why);
	if (r < 0)
		goto err_done;
	memfile.base = map_aligned(fd, memfile.bytes);
	if (memfile.base == MAP_FAILED) {
		memfile.base = NULL;
		r = why_errno(why, -errno, "mapping kept memory");
		goto err_done;
	}
	r = open_for_reading(&memfile, why);
	if (r < 0)
		goto err_done;
	*ret = memfile;
	return 0;

err_done:
	memfile_done(&memfile);
	return r;
}

void memfile_done(struct memfile *memfile)
{
	if (memfile->base)
		(void)munmap(memfile->base, memfile->bytes);
	(void)fd_close(memfile->read_fd);
	(void)fd_close(memfile->fd);
	*memfile = MEMFILE_NONE;
}

void memfile_reclaim(struct memfile *memfile)
{
	(void)fallocate(memfile->fd, FALLOC_FL_PUNCH_HOLE | FALLOC_FL_KEEP_SIZE, 0,
			(off_t)memfile->bytes);
}
