/* SPDX-License-Identifier: MIT */
#include "viewer/cache_view.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include <epoxy/gl.h>

#include "libclient/look_ahead.h"

/* Of the window's width; the picture is as high as that, or as the window. */
#define SHARE    3u
#define SIDE_MAX 640u
#define MARGIN   8u

struct cache_view {
	const struct world *world;
	struct birds_eye_node *nodes;
	uint32_t *scratch;
	struct ooc_want *expected; /* LOOK_AHEAD_WANT_COUNT_MAX */
	uint8_t *rgb;
	GLuint texture;
	GLuint framebuffer;
	uint32_t side; /* of the texture */
};

int cache_view_create(const struct world *world, struct cache_view **ret, struct why *why)
{
	struct cache_view *cache_view = calloc(1, sizeof(*cache_view));
	size_t count = world->stores[0].superblock->node_count + 1;

	if (cache_view) {
		cache_view->world = world;
		cache_view->nodes = calloc(count, sizeof(*cache_view->nodes));
		cache_view->scratch = calloc(count, sizeof(*cache_view->scratch));
		cache_view->expected =
			calloc(LOOK_AHEAD_WANT_COUNT_MAX, sizeof(*cache_view->expected));
		cache_view->rgb = calloc((size_t)SIDE_MAX * SIDE_MAX, 3);
	}
	if (!cache_view || !cache_view->nodes || !cache_view->scratch || !cache_view->expected ||
	    !cache_view->rgb) {
		cache_view_destroy(cache_view);
		return why_errno(why, -ENOMEM, "the view of the cache");
	}
	glCreateFramebuffers(1, &cache_view->framebuffer);
	*ret = cache_view;
	return 0;
}

struct cache_view *cache_view_destroy(struct cache_view *cache_view)
{
	if (!cache_view)
		return NULL;
	glDeleteFramebuffers(1, &cache_view->framebuffer);
	glDeleteTextures(1, &cache_view->texture);
	free(cache_view->nodes);
	free(cache_view->scratch);
	free(cache_view->expected);
	free(cache_view->rgb);
	free(cache_view);
	return NULL;
}

static enum birds_eye_state state_of(struct ooc_store *store, const struct store_node *record,
				     uint32_t node)
{
	if (record->payload_id == 0)
		return BIRDS_EYE_NOTHING;
	switch (ooc_node_state(store, node)) {
	case OOC_STATE_BUSY:
		return BIRDS_EYE_BUSY;
	case OOC_STATE_READY:
		return BIRDS_EYE_READY;
	case OOC_STATE_DAMAGED:
		return BIRDS_EYE_DAMAGED;
	case OOC_STATE_ABSENT:
		break;
	}
	return BIRDS_EYE_ABSENT;
}

/* What is known of each node.  Returns: how many are wanted. */
static uint32_t look(struct cache_view *cache_view, struct foresight *foresight)
{
	const struct world *world = cache_view->world;
	const struct world_store *store = &world->stores[0];
	uint32_t want_count = 0;
	size_t expected_count = 0;

	for (uint32_t i = 0; i < store->superblock->node_count; i++)
		cache_view->nodes[i] =
			(struct birds_eye_node){ .state = (uint8_t)state_of(store->store,
									    &store->nodes[i], i) };
	for (size_t i = 0; i < world->want_count; i++) {
		struct birds_eye_node *node;

		if (world->wants[i].store != 0)
			continue;
		node = &cache_view->nodes[world->wants[i].node];
		node->is_wanted = true;
		node->set_place = want_count++;
		if (node->state == BIRDS_EYE_READY)
			node->state = BIRDS_EYE_HELD;
	}
	if (foresight)
		expected_count = foresight_expected(foresight, cache_view->expected);
	for (size_t i = 0; i < expected_count; i++)
		if (cache_view->expected[i].store == store->store)
			cache_view->nodes[cache_view->expected[i].node].is_expected = true;
	return want_count;
}

static void fit_texture(struct cache_view *cache_view, uint32_t side)
{
	if (cache_view->side == side)
		return;
	glDeleteTextures(1, &cache_view->texture);
	glCreateTextures(GL_TEXTURE_2D, 1, &cache_view->texture);
	glTextureStorage2D(cache_view->texture, 1, GL_RGB8, (GLsizei)side, (GLsizei)side);
	glNamedFramebufferTexture(cache_view->framebuffer, GL_COLOR_ATTACHMENT0,
				  cache_view->texture, 0);
	cache_view->side = side;
}

void cache_view_draw(struct cache_view *cache_view, const struct camera *camera,
		     struct foresight *foresight, enum birds_eye_colouring colouring,
		     uint32_t window_width, uint32_t window_height)
{
	const struct world_store *store = &cache_view->world->stores[0];
	struct camera scaled = *camera;
	struct birds_eye birds_eye = {
		.superblock = store->superblock,
		.records = store->nodes,
		.nodes = cache_view->nodes,
		.camera = &scaled,
		.aspect = (double)window_width / window_height,
		.colouring = colouring,
	};
	uint32_t side = window_width / SHARE;
	GLint left;
	GLint top;

	side = side < window_height - 2 * MARGIN ? side : window_height - 2 * MARGIN;
	side = side < SIDE_MAX ? side : SIDE_MAX;
	if (window_width < SHARE || window_height <= 2 * MARGIN)
		return;
	for (unsigned k = 0; k < 3; k++) {
		scaled.eye[k] /= store->scale;
		scaled.at[k] /= store->scale;
	}
	birds_eye.want_count = look(cache_view, foresight);
	birds_eye_paint(&birds_eye, side, side, cache_view->scratch, cache_view->rgb);
	fit_texture(cache_view, side);
	glPixelStorei(GL_UNPACK_ALIGNMENT, 1);
	glTextureSubImage2D(cache_view->texture, 0, 0, 0, (GLsizei)side, (GLsizei)side, GL_RGB,
			    GL_UNSIGNED_BYTE, cache_view->rgb);
	/* The picture's first row is its top, the framebuffer's its bottom. */
	left = (GLint)(window_width - side - MARGIN);
	top = (GLint)(window_height - MARGIN);
	glBlitNamedFramebuffer(cache_view->framebuffer, 0, 0, 0, (GLint)side, (GLint)side, left,
			       top, left + (GLint)side, top - (GLint)side, GL_COLOR_BUFFER_BIT,
			       GL_NEAREST);
}
