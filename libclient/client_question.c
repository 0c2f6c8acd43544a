/* SPDX-License-Identifier: MIT */
/*
 * Questions and orders.  Each has one answer, and the daemon hears one at a time; an answer that did
 * not come in time is still to come, and is let pass then.
 */
#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/check.h"
#include "formats/base/clock.h"
#include "libclient/client_private.h"

_Static_assert((int)OOC_EVICT == (int)WIRE_ADMIN_EVICT && (int)OOC_PIN == (int)WIRE_ADMIN_PIN &&
		       (int)OOC_UNPIN == (int)WIRE_ADMIN_UNPIN &&
		       (int)OOC_RELOAD == (int)WIRE_ADMIN_RELOAD,
	       "orders have one number each");
_Static_assert(OOC_ORDER_NODE_COUNT_MAX == WIRE_ADMIN_NODE_COUNT_MAX, "an order is one message");
_Static_assert(OOC_INSPECT_COUNT_MAX == WIRE_NODES_ENTRY_COUNT_MAX, "so is its answer");

/* ---- answers ---- */

void answer_lose(struct ooc_client *client)
{
	struct answer *answer = &client->answer;

	if (answer->wanted) {
		answer->done = true;
		answer->error = -ENOTCONN;
	}
	answer->abandoned_count = 0;
}

int answer_take_text(struct ooc_client *client, const struct wire_text *message)
{
	struct answer *answer = &client->answer;
	char *text;

	if (answer->abandoned_count > 0) {
		answer->abandoned_count -= message->last;
		return 0;
	}
	if (!answer->wanted || answer->done || answer->nodes)
		return why_set(&client->why, -EPROTO, "the daemon sends a text unasked");
	if (answer->text_bytes + message->text_bytes > ANSWER_BYTES_MAX)
		return why_set(&client->why, -EPROTO, "the daemon's answer does not end");
	text = realloc(answer->text, answer->text_bytes + message->text_bytes + 1);
	if (!text)
		return why_set(&client->why, -ENOMEM, "no memory for the daemon's answer");
	memcpy(text + answer->text_bytes, message->text, message->text_bytes);
	answer->text = text;
	answer->text_bytes += message->text_bytes;
	text[answer->text_bytes] = '\0';
	answer->done = message->last != 0;
	return 0;
}

static enum ooc_state state_of(uint16_t cached)
{
	switch ((enum wire_cached)cached) {
	case WIRE_CACHED_BUSY:
		return OOC_STATE_BUSY;
	case WIRE_CACHED_HELD:
	case WIRE_CACHED_FREE:
		return OOC_STATE_READY;
	case WIRE_CACHED_DAMAGED:
		return OOC_STATE_DAMAGED;
	case WIRE_CACHED_ABSENT:
	case WIRE_CACHED_COUNT_:
		break;
	}
	return OOC_STATE_ABSENT;
}

int answer_take_nodes(struct ooc_client *client, const struct wire_nodes *message)
{
	struct answer *answer = &client->answer;

	if (answer->abandoned_count > 0) {
		answer->abandoned_count--;
		return 0;
	}
	if (!answer->wanted || answer->done || !answer->nodes)
		return why_set(&client->why, -EPROTO, "the daemon sends states of nodes unasked");
	for (uint32_t i = 0; i < message->entry_count; i++) {
		const struct wire_node *node = &message->entries[i];

		answer->nodes[i] = (struct ooc_node_info){
			.state = state_of(node->cached),
			.replaced = node->order,
			.holds = node->holds,
			.payer = node->payer,
			.age_s = node->age_ds == WIRE_AGE_NEVER ? -1.0 : node->age_ds / 10.0,
			.pinned = node->flags & WIRE_NODE_PINNED,
			.unused_prefetch = node->flags & WIRE_NODE_UNUSED_PREFETCH,
		};
	}
	answer->node_count = message->entry_count;
	answer->done = true;
	return 0;
}

void answer_take_error(struct ooc_client *client, const struct wire_error *error)
{
	struct answer *answer = &client->answer;

	if (answer->abandoned_count > 0) {
		answer->abandoned_count--;
	} else if (answer->wanted) {
		answer->done = true;
		answer->error = error->error;
	}
}

/* ---- questions ---- */

/* Sends until the socket has room, and waits.  Returns: 0 or -errno, of the session or the answer. */
static int await_answer(struct ooc_client *client, const struct wire_header *question)
{
	struct answer *answer = &client->answer;
	uint64_t deadline_ns = clock_now_ns() + ANSWER_TIMEOUT_NS;
	bool asked = false;
	int r;

	for (;;) {
		if (!asked) {
			r = session_send(client, question, question->bytes, NULL, 0);
			if (r < 0 && r != -EAGAIN)
				return r;
			asked = r == 0;
		}
		session_pause(client, deadline_ns);
		r = session_run(client);
		if (answer->done)
			return answer->error;
		if (r < 0)
			return r;
		if (clock_now_ns() >= deadline_ns) {
			answer->abandoned_count += asked;
			return why_set(&client->why, -ETIMEDOUT, "the daemon does not answer");
		}
	}
}

/* nodes:  NULL: the answer is a text. */
static int ask(struct ooc_client *client, const struct wire_header *question,
	       struct ooc_node_info *nodes)
{
	int r;

	if (client->state != SESSION_LIVE)
		return why_set(&client->why, -ENOTCONN, "the daemon is away");
	free(client->answer.text);
	client->answer = (struct answer){
		.wanted = true,
		.nodes = nodes,
		.abandoned_count = client->answer.abandoned_count,
	};
	r = await_answer(client, question);
	client->answer.wanted = false;
	return r;
}

static int ask_for_text(struct ooc_client *client, const struct wire_header *question, char **ret)
{
	int r = ask(client, question, NULL);

	if (r < 0)
		return r;
	*ret = client->answer.text;
	client->answer.text = NULL;
	return 0;
}

static int ask_status(struct ooc_client *client, enum wire_status_what what, char **ret)
{
	struct wire_status question = { .what = what };

	wire_header_init(&question.header, WIRE_STATUS, sizeof(question));
	return ask_for_text(client, &question.header, ret);
}

int ooc_status(struct ooc_client *client, char **ret)
{
	return ask_status(client, WIRE_STATUS_ALL, ret);
}

int ooc_metrics(struct ooc_client *client, char **ret)
{
	return ask_status(client, WIRE_STATUS_METRICS, ret);
}

static int check_store(struct ooc_client *client, const struct ooc_store *store)
{
	if (store->state == STORE_LOST)
		return why_set(&client->why, store->error, "the daemon serves the store no longer");
	if (store->state != STORE_OPEN)
		return why_set(&client->why, -ENOTCONN,
			       "the store is not open in this session yet");
	return 0;
}

int ooc_steer(struct ooc_client *client, enum ooc_order order, struct ooc_store *store,
	      const uint32_t *nodes, size_t node_count, char **ret)
{
	/* The message is as long as it needs to be; the daemon's buffers are not smaller. */
	_Alignas(8) uint8_t bytes[WIRE_MESSAGE_BYTES_MAX];
	struct wire_admin *message = (struct wire_admin *)(void *)bytes;
	int r;

	if (order < OOC_EVICT || order > OOC_RELOAD)
		return why_set(&client->why, -EINVAL, "there is no order %d", (int)order);
	if ((order == OOC_PIN && !store) || (order == OOC_RELOAD && store) ||
	    (!store && node_count > 0))
		return why_set(&client->why, -EINVAL, "an order for %s store",
			       store ? "the daemon, with a" : "nodes, without a");
	if (node_count > OOC_ORDER_NODE_COUNT_MAX)
		return why_set(&client->why, -E2BIG, "%zu nodes, one order is for %u at most",
			       node_count, OOC_ORDER_NODE_COUNT_MAX);
	r = store ? check_store(client, store) : 0;
	if (r < 0)
		return r;
	for (size_t i = 0; i < node_count; i++)
		if (nodes[i] >= store->node_count || store->nodes[nodes[i]].payload_id == 0)
			return why_set(&client->why, -EINVAL, "node %u has nothing to draw",
				       nodes[i]);
	*message = (struct wire_admin){
		.what = order,
		.store = store                 ? store->number
			 : order == OOC_RELOAD ? 0
					       : WIRE_STORE_ALL,
		.node_count = (uint32_t)node_count,
	};
	if (node_count > 0)
		memcpy(message->nodes, nodes, node_count * sizeof(nodes[0]));
	wire_header_init(&message->header, WIRE_ADMIN,
			 sizeof(*message) + node_count * sizeof(nodes[0]));
	return ask_for_text(client, &message->header, ret);
}

int ooc_inspect(struct ooc_store *store, uint32_t first, struct ooc_node_info *ret)
{
	struct ooc_client *client = store->client;
	struct wire_status question = {
		.what = WIRE_STATUS_NODES,
		.store = store->number,
		.first = first,
	};
	int r = check_store(client, store);

	if (r < 0)
		return r;
	wire_header_init(&question.header, WIRE_STATUS, sizeof(question));
	r = ask(client, &question.header, ret);
	return r < 0 ? r : (int)client->answer.node_count;
}
