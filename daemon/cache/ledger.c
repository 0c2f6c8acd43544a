/* SPDX-License-Identifier: MIT */
#include "daemon/cache/ledger.h"

#include <errno.h>
#include <string.h>

#include "formats/base/file.h"

static const char magic[8] = "OOCLEDG";

static uint64_t file_bytes(uint64_t node_count)
{
	return sizeof(struct ledger_header) + node_count * (sizeof(uint64_t) + 1);
}

static void point_into(struct ledger *ledger, uint64_t node_count)
{
	ledger->header = ledger->file.base;
	ledger->checksums = (uint64_t *)(void *)(ledger->header + 1);
	ledger->held = (_Atomic uint8_t *)(void *)(ledger->checksums + node_count);
}

int ledger_create(const struct ledger_header *header, struct ledger *ret, struct why *why)
{
	struct ledger ledger = LEDGER_NONE;
	int r;

	r = memfile_create("oocd-ledger", file_bytes(header->node_count), false, &ledger.file, why);
	if (r < 0)
		return r;
	point_into(&ledger, header->node_count);
	*ledger.header = *header;
	memcpy(ledger.header->magic, magic, sizeof(magic));
	ledger.header->version = LEDGER_VERSION;
	r = memfile_publish(&ledger.file, MEMFILE_CHANGING, why);
	if (r < 0) {
		ledger_done(&ledger);
		return r;
	}
	*ret = ledger;
	return 0;
}

int ledger_adopt(int fd, struct ledger *ret, struct why *why)
{
	struct ledger ledger = LEDGER_NONE;
	const struct ledger_header *header;
	int r = memfile_adopt(fd, &ledger.file, why);

	if (r < 0)
		return r;
	header = ledger.file.base;
	if (ledger.file.bytes < sizeof(*header) ||
	    memcmp(header->magic, magic, sizeof(magic)) != 0 || header->version != LEDGER_VERSION ||
	    header->node_count > ledger.file.bytes ||
	    file_bytes(header->node_count) > ledger.file.bytes ||
	    memchr(header->path, '\0', sizeof(header->path)) == NULL) {
		ledger_done(&ledger);
		return why_set(why, -EUCLEAN, "kept by another version of oocd");
	}
	point_into(&ledger, header->node_count);
	*ret = ledger;
	return 0;
}

void ledger_done(struct ledger *ledger)
{
	memfile_done(&ledger->file);
	*ledger = LEDGER_NONE;
}
