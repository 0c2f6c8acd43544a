/* SPDX-License-Identifier: MIT */
/**
 * list.h - intrusive doubly linked ring.  An entry that is on no list points at itself, so that
 * taking it off is always allowed.
 */
#ifndef FORMATS_BASE_LIST_H
#define FORMATS_BASE_LIST_H

#include <stdbool.h>
#include <stddef.h>

struct list {
	struct list *next;
	struct list *prev;
};

#define LIST_ENTRY(link, type, member) ((type *)(void *)((char *)(link)-offsetof(type, member)))

/** Walks a list from its first entry; the current entry may be taken off. */
#define LIST_FOR_EACH(link, head)                                                                  \
	for (struct list *link = (head)->next, *link##_next = link->next; link != (head);          \
	     link = link##_next, link##_next = link->next)

static inline void list_init(struct list *list)
{
	list->next = list;
	list->prev = list;
}

static inline bool list_is_empty(const struct list *list)
{
	return list->next == list;
}

static inline void list_remove(struct list *link)
{
	link->prev->next = link->next;
	link->next->prev = link->prev;
	list_init(link);
}

/** `last` becomes the last of its list, and what follows it comes first. */
static inline void list_rotate(struct list *head, struct list *last)
{
	list_remove(head);
	head->prev = last;
	head->next = last->next;
	last->next->prev = head;
	last->next = head;
}

static inline void list_push_back(struct list *head, struct list *link)
{
	link->prev = head->prev;
	link->next = head;
	head->prev->next = link;
	head->prev = link;
}

static inline void list_push_front(struct list *head, struct list *link)
{
	list_push_back(head->next, link);
}

#endif /* FORMATS_BASE_LIST_H */
