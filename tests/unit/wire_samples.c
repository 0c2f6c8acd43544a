/* SPDX-License-Identifier: MIT */
#include "tests/unit/wire_samples.h"

#include <errno.h>
#include <string.h>

static _Alignas(8) uint8_t memory[2048];

static void hello_fill(struct wire_hello *message)
{
	message->version = WIRE_VERSION;
	(void)strcpy(message->name, "oocview");
}

static void open_fill(struct wire_open *message)
{
	message->store = 5;
	(void)strcpy(message->path, "/models/plant.ooc");
}

static size_t set_fill(struct wire_set *message)
{
	message->serial = 0x0102030405060708;
	message->flags = WIRE_SET_FLAGS_ALL;
	message->entry_count = 2;
	message->entries[0] = (struct wire_entry){ .store = 1, .node = 1000, .importance = 2.5f };
	message->entries[1] = (struct wire_entry){ .store = 63, .node = 7, .importance = 0.0f };
	return sizeof(*message) + 2 * sizeof(message->entries[0]);
}

static size_t prefetch_fill(struct wire_prefetch *message)
{
	message->entry_count = 1;
	message->entries[0] = (struct wire_entry){ .store = 2, .node = 3, .importance = 1.0f };
	return sizeof(*message) + sizeof(message->entries[0]);
}

static void opened_fill(struct wire_opened *message)
{
	message->store = 5;
	message->segment_bytes_log2 = 26;
	message->generation = 9;
	message->node_count = 1000;
	for (uint8_t i = 0; i < sizeof(message->uuid); i++)
		message->uuid[i] = (uint8_t)(0xa0 + i);
	message->hs_bytes = 4096 + 128 * 1000;
	message->directory_bytes = 64 + 8 * 1000;
	message->grants_bytes = 64 + 8 * 16;
}

static size_t not_now_fill(struct wire_not_now *message)
{
	message->serial = 77;
	message->entry_count = 2;
	message->entries[0] = (struct wire_refusal){ .store = 1, .node = 12, .reason = 1 };
	message->entries[1] = (struct wire_refusal){ .store = 1, .node = 13, .reason = 4 };
	return sizeof(*message) + 2 * sizeof(message->entries[0]);
}

static size_t admin_fill(struct wire_admin *message)
{
	message->what = WIRE_ADMIN_PIN;
	message->store = 5;
	message->node_count = 2;
	message->nodes[0] = 12;
	message->nodes[1] = 0x01020304;
	return sizeof(*message) + 2 * sizeof(message->nodes[0]);
}

static size_t nodes_fill(struct wire_nodes *message)
{
	message->store = 5;
	message->first = 1024;
	message->entry_count = 2;
	message->entries[0] = (struct wire_node){
		.order = 0x3132333435363738,
		.age_ds = 600,
		.payer = 3,
		.cached = WIRE_CACHED_FREE,
		.flags = WIRE_NODE_UNUSED_PREFETCH,
	};
	message->entries[1] = (struct wire_node){
		.age_ds = 7,
		.holds = 2,
		.payer = 4,
		.cached = WIRE_CACHED_HELD,
		.flags = WIRE_NODE_PINNED,
	};
	return sizeof(*message) + 2 * sizeof(message->entries[0]);
}

static size_t text_fill(struct wire_text *message)
{
	static const char text[] = { '{', '"', 'a', '"', ':', '1', '}' };

	message->last = 1;
	message->text_bytes = sizeof(text);
	memcpy(message->text, text, sizeof(text));
	return sizeof(*message) + sizeof(text);
}

static void error_fill(struct wire_error *message)
{
	message->error = -EUCLEAN;
	message->type = WIRE_OPEN;
	message->store = 5;
	message->version = WIRE_VERSION;
	(void)strcpy(message->text, "no superblock is whole");
}

static const enum wire_type types[WIRE_SAMPLE_COUNT] = {
	WIRE_HELLO,        WIRE_OPEN,   WIRE_CLOSE,   WIRE_SET,    WIRE_RETIRE,
	WIRE_PREFETCH,     WIRE_STATUS, WIRE_WELCOME, WIRE_OPENED, WIRE_SEGMENT,
	WIRE_SEGMENT_GONE, WIRE_EVENT,  WIRE_NOT_NOW, WIRE_TEXT,   WIRE_ERROR,
	WIRE_ADMIN,        WIRE_NODES,  WIRE_RECALL,  WIRE_LISTEN,
};

/* Fills the body.  Returns: the message's length. */
static size_t body_fill(enum wire_type type)
{
	struct wire_close *close = (void *)memory;
	struct wire_retire *retire = (void *)memory;
	struct wire_status *status = (void *)memory;
	struct wire_welcome *welcome = (void *)memory;
	struct wire_segment *segment = (void *)memory;
	struct wire_segment_gone *gone = (void *)memory;
	struct wire_event *event = (void *)memory;
	struct wire_recall *recall = (void *)memory;

	switch (type) {
	case WIRE_HELLO:
		hello_fill((void *)memory);
		return sizeof(struct wire_hello);
	case WIRE_OPEN:
		open_fill((void *)memory);
		return sizeof(struct wire_open);
	case WIRE_CLOSE:
		close->store = 5;
		return sizeof(*close);
	case WIRE_SET:
		return set_fill((void *)memory);
	case WIRE_RETIRE:
		retire->serial = 0x1112131415161718;
		return sizeof(*retire);
	case WIRE_LISTEN:
		return sizeof(struct wire_listen);
	case WIRE_PREFETCH:
		return prefetch_fill((void *)memory);
	case WIRE_STATUS:
		*status = (struct wire_status){ .what = WIRE_STATUS_NODES,
						.store = 5,
						.first = 1024 };
		return sizeof(*status);
	case WIRE_ADMIN:
		return admin_fill((void *)memory);
	case WIRE_WELCOME:
		*welcome = (struct wire_welcome){ .version = WIRE_VERSION,
						  .session = 3,
						  .epoch = 0x2122232425262728,
						  .page_bytes = 4096 };
		return sizeof(*welcome);
	case WIRE_OPENED:
		opened_fill((void *)memory);
		return sizeof(struct wire_opened);
	case WIRE_SEGMENT:
		*segment = (struct wire_segment){ .store = 5,
						  .segment = 2,
						  .segment_bytes = 64 << 20 };
		return sizeof(*segment);
	case WIRE_SEGMENT_GONE:
		*gone = (struct wire_segment_gone){ .store = 5, .segment = 2 };
		return sizeof(*gone);
	case WIRE_EVENT:
		*event = (struct wire_event){ .serial = 77, .settled = 1, .missing_count = 4 };
		return sizeof(*event);
	case WIRE_RECALL:
		recall->serial = 77;
		return sizeof(*recall);
	case WIRE_NOT_NOW:
		return not_now_fill((void *)memory);
	case WIRE_NODES:
		return nodes_fill((void *)memory);
	case WIRE_TEXT:
		return text_fill((void *)memory);
	case WIRE_ERROR:
		error_fill((void *)memory);
		return sizeof(struct wire_error);
	}
	return 0;
}

void wire_sample_make(size_t index, struct wire_sample *ret)
{
	enum wire_type type = types[index];

	memset(memory, 0, sizeof(memory));
	*ret = (struct wire_sample){
		.side = type < WIRE_WELCOME ? WIRE_FROM_CLIENT : WIRE_FROM_DAEMON,
		.fd_count = type == WIRE_OPENED                                                 ? 3
			    : type == WIRE_OPEN || type == WIRE_WELCOME || type == WIRE_SEGMENT ? 1
												: 0,
		.bytes = body_fill(type),
		.header = (void *)memory,
		.message = memory,
	};
	wire_header_init(ret->header, type, ret->bytes);
}
