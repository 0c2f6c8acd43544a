/* SPDX-License-Identifier: MIT */
#include "libclient/mapping.h"

#include <errno.h>
#include <fcntl.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/mman.h>
#include <sys/stat.h>

#include "formats/base/bytes.h"

#define PAGE_BYTES 4096u

/* Of a page that the kernel maps with one entry where the file has one as large. */
#define HUGE_BYTES (2 * MIB)

/*
 * Maps at an address that 2 MiB pages can be used at.  The kernel chooses such a one for a memory file
 * only where it makes huge pages for all of them; the daemon makes them for its own.  On small pages
 * a frame that touches a thousand payloads would fault, and miss the table of pages, a thousand times.
 */
static void *map_aligned(int fd, uint64_t bytes)
{
	uint64_t reserved_bytes = bytes + HUGE_BYTES;
	uint8_t *reserved;
	uint8_t *base;

	if (bytes < HUGE_BYTES)
		return mmap(NULL, bytes, PROT_READ, MAP_SHARED, fd, 0);
	reserved = mmap(NULL, reserved_bytes, PROT_NONE,
			MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
	if (reserved == MAP_FAILED)
		return MAP_FAILED;
	base = reserved + (bytes_round_up((uintptr_t)reserved, HUGE_BYTES) - (uintptr_t)reserved);
	if (mmap(base, bytes, PROT_READ, MAP_SHARED | MAP_FIXED, fd, 0) == MAP_FAILED) {
		(void)munmap(reserved, reserved_bytes);
		return MAP_FAILED;
	}
	if (base > reserved)
		(void)munmap(reserved, (size_t)(base - reserved));
	/* Less than a page may be left behind a length that is no whole number of them. */
	base += bytes_round_up(bytes, PAGE_BYTES);
	if (base < reserved + reserved_bytes)
		(void)munmap(base, (size_t)(reserved + reserved_bytes - base));
	return base - bytes_round_up(bytes, PAGE_BYTES);
}

int mapping_init(int fd, uint64_t bytes, struct mapping *ret, struct why *why)
{
	struct stat status;
	void *base;
	int seals;

	if (fstat(fd, &status) < 0 || !S_ISREG(status.st_mode))
		return why_set(why, -EPROTO, "the daemon shares something that is no memory file");
	if (bytes == 0 || (uint64_t)status.st_size < bytes)
		return why_set(why, -EPROTO, "the daemon shares %lld bytes and says %llu",
			       (long long)status.st_size, (unsigned long long)bytes);
	/* Only memory files have seals: anything else fails here. */
	seals = fcntl(fd, F_GET_SEALS);
	if (seals < 0 || !(seals & F_SEAL_SHRINK))
		return why_set(why, -EPROTO, "the daemon shares memory that may still shrink");

	base = map_aligned(fd, bytes);
	if (base == MAP_FAILED)
		return why_errno(why, -ENOMEM, "cannot map %llu bytes of the daemon's memory",
				 (unsigned long long)bytes);
	*ret = (struct mapping){ .base = base, .bytes = bytes };
	return 0;
}

void mapping_done(struct mapping *mapping)
{
	/* munmap() does not write there; its type has no const. */
	if (mapping->base)
		(void)munmap((void *)(uintptr_t)mapping->base, mapping->bytes);
	*mapping = (struct mapping){ 0 };
}
