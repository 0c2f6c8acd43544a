/* SPDX-License-Identifier: MIT */
/* Orders to the daemon, and who may give them. */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "daemon/server/server_private.h"
#include "formats/base/check.h"
#include "formats/base/log.h"

bool server_is_admin(const struct server *server, const struct session *session)
{
	const struct connection *connection = session->connection;
	uid_t uid = connection_uid(connection);
	gid_t group = server->config.admin_gid;

	return uid == 0 || uid == geteuid() ||
	       (group != 0 && connection_in_group(connection, group));
}

/* The nodes of an order: those that it names, or all of the store. */
struct order {
	struct served *served;
	const uint32_t *nodes; /* NULL: all */
	uint32_t node_count;
};

static int order_init(struct order *ret, const struct session *session,
		      const struct wire_admin *admin, struct why *why)
{
	const struct attachment *attachment = session->visible.attachments[admin->store];

	if (!attachment)
		return why_set(why, -ENOENT, "the store is not open in this session");
	*ret = (struct order){ attachment->served, NULL, attachment->served->node_count };
	if (admin->node_count == 0)
		return 0;
	ret->nodes = admin->nodes;
	ret->node_count = admin->node_count;
	for (uint32_t i = 0; i < ret->node_count; i++)
		if (!served_has_payload(ret->served, ret->nodes[i]))
			return why_set(why, -ENOENT,
				       "node %u: not in the store, or without a payload",
				       ret->nodes[i]);
	return 0;
}

/* ---- evict ---- */

struct evicted {
	uint32_t nodes;
	uint64_t bytes;
	uint32_t held; /* or being read: not evicted */
};

static void evict_node(struct served *served, uint32_t index, struct evicted *sum)
{
	enum node_state state = served->nodes[index].state;

	if (cache_evict(served, index)) {
		sum->nodes++;
		sum->bytes += (uint64_t)served_pages(served, index) * WIRE_PAGE_BYTES;
	} else if (state == NODE_HELD || state == NODE_BUSY) {
		sum->held++;
	}
}

static void evict_order(const struct order *order, struct evicted *sum)
{
	for (uint32_t i = 0; i < order->node_count; i++)
		evict_node(order->served, order->nodes ? order->nodes[i] : i, sum);
}

static void evict_all(struct server *server, struct evicted *sum)
{
	LIST_FOR_EACH (link, &server->cache.stores) {
		struct served *served = LIST_ENTRY(link, struct served, link);
		struct order order = { served, NULL, served->node_count };

		evict_order(&order, sum);
	}
}

/* ---- orders ---- */

static void unpin_all(struct server *server, struct residents_sum *sum)
{
	LIST_FOR_EACH (link, &server->cache.stores) {
		struct served *served = LIST_ENTRY(link, struct served, link);
		struct residents_sum of_store;

		residents_unpin(&server->residents, served, NULL, served->node_count, &of_store);
		sum->nodes += of_store.nodes;
		sum->bytes += of_store.bytes;
		sum->there += of_store.there;
	}
}

static int answer_pins(const struct server *server, const struct residents_sum *sum,
		       char **ret_text)
{
	return asprintf(ret_text,
			"{\"nodes\":%u,\"bytes\":%llu,\"ready_nodes\":%u,\"pinned_bytes\":%llu}\n",
			sum->nodes, (unsigned long long)sum->bytes, sum->there,
			(unsigned long long)residents_bytes(&server->residents)) < 0
		       ? -ENOMEM
		       : 0;
}

static int answer_evicted(const struct evicted *sum, char **ret_text)
{
	return asprintf(ret_text, "{\"nodes\":%u,\"bytes\":%llu,\"held_nodes\":%u}\n", sum->nodes,
			(unsigned long long)sum->bytes, sum->held) < 0
		       ? -ENOMEM
		       : 0;
}

static int obey(struct server *server, const struct session *session,
		const struct wire_admin *admin, char **ret_text, struct why *why)
{
	struct residents_sum sum = { 0 };
	struct evicted evicted = { 0 };
	struct order order = { 0 };
	int r = 0;

	if (admin->what != WIRE_ADMIN_RELOAD && admin->store != WIRE_STORE_ALL)
		r = order_init(&order, session, admin, why);
	if (r < 0)
		return r;
	switch ((enum wire_admin_what)admin->what) {
	case WIRE_ADMIN_EVICT:
		if (order.served)
			evict_order(&order, &evicted);
		else
			evict_all(server, &evicted);
		return answer_evicted(&evicted, ret_text);
	case WIRE_ADMIN_PIN:
		r = residents_pin(&server->residents, order.served, order.nodes, order.node_count,
				  &sum, why);
		return r < 0 ? r : answer_pins(server, &sum, ret_text);
	case WIRE_ADMIN_UNPIN:
		if (order.served)
			residents_unpin(&server->residents, order.served, order.nodes,
					order.node_count, &sum);
		else
			unpin_all(server, &sum);
		return answer_pins(server, &sum, ret_text);
	case WIRE_ADMIN_RELOAD:
		r = server_reload(server, why);
		return r < 0 ? r : asprintf(ret_text, "{\"reloaded\":true}\n") < 0 ? -ENOMEM : 0;
	case WIRE_ADMIN_COUNT_:
		break;
	}
	CHECK(false);
	return -EINVAL;
}

static const char *order_name(const struct wire_admin *admin)
{
	static const char *const names[WIRE_ADMIN_COUNT_] = {
		[WIRE_ADMIN_EVICT] = "evict",
		[WIRE_ADMIN_PIN] = "pin",
		[WIRE_ADMIN_UNPIN] = "unpin",
		[WIRE_ADMIN_RELOAD] = "reload",
	};

	return names[admin->what];
}

int server_admin(struct server *server, struct session *session, const struct wire_admin *admin,
		 char **ret_text, struct why *why)
{
	int r;

	if (!server_is_admin(server, session))
		return why_set(why, -EACCES,
			       "%s is for root, the user of oocd and its group of administrators "
			       "alone: see admin-group in oocd.conf(5)",
			       order_name(admin));
	r = obey(server, session, admin, ret_text, why);
	if (r == -ENOMEM)
		return why_errno(why, r, "the answer");
	log_info("%s, ordered by uid %d (pid %d): %s", order_name(admin),
		 (int)connection_uid(session->connection), (int)connection_pid(session->connection),
		 r < 0 ? why->text : "done");
	return r;
}
