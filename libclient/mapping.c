/* SPDX-License-Identifier: MIT */
#include "libclient/mapping.h"

#include <errno.h>
#include <fcntl.h>
#include <stddef.h>
#include <sys/mman.h>
#include <sys/stat.h>

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

	base = mmap(NULL, bytes, PROT_READ, MAP_SHARED, fd, 0);
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
