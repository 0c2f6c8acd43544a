/* SPDX-License-Identifier: MIT */
#include "viewer/window.h"

#include <errno.h>
#include <math.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include <epoxy/gl.h>

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>

#include "formats/base/bytes.h"
#include "formats/base/clock.h"
#include "formats/base/log.h"
#include "viewer/cache_view.h"
#include "viewer/camera_control.h"
#include "viewer/gesture.h"
#include "viewer/hud.h"
#include "viewer/part_names.h"
#include "viewer/stop.h"
#include "viewer/window_text.h"

/* How often it looks for nodes that are missing, and, at rest, for the daemon and signals. */
#define MISSING_WAIT_S 0.004
#define IDLE_WAIT_S    0.25
/* How long a message stays. */
#define MESSAGE_NS (6 * NS_PER_S)
/* How often bytes a second are told anew where nothing else is. */
#define RATE_NS (NS_PER_S / 4)
/* A pause in the loop is no long step of the walker. */
#define STEP_S_MAX 0.1
#define BUDGET_MIN 1000u
#define BUDGET_MAX (UINT64_C(1) << 40)

struct window {
	struct show *show;
	GLFWwindow *handle;
	struct hud *hud;
	struct target target;
	struct part_names part_names[WORLD_STORE_COUNT_MAX];
	struct frame_style style;
	struct camera camera;
	struct gesture gesture;
	double cursor[2]; /* pixels of the picture, from the upper left */
	uint64_t begin_ns;
	uint64_t now_ns;
	uint64_t shown_ns; /* when the window was last painted */

	bool must_draw; /* the picture would differ from the one shown */
	bool must_show; /* only what lies over it would */
	bool shows_help;
	bool hides_hud;
	unsigned map;                  /* 0: none; else 1 + enum birds_eye_colouring */
	struct cache_view *cache_view; /* once it was asked for */
	char message[WINDOW_TEXT_MESSAGE_BYTES];
	uint64_t message_ns; /* when it came; 0: there is none */

	struct frame_report report; /* of the picture shown */
	struct window_rate rate;
	bool shows_rate;       /* the text says that bytes come: it must be told when none do */
	size_t drawable_count; /* of the picture shown, as the client says */

	bool is_playing; /* the path */
	size_t play_frame;
	uint64_t play_begin_ns;
	size_t frames_written;
	int error; /* that ends the loop */
	struct why why;
};

static void __attribute__((format(printf, 2, 3)))
say(struct window *window, const char *format, ...)
{
	va_list args;

	va_start(args, format);
	(void)vsnprintf(window->message, sizeof(window->message), format, args);
	va_end(args);
	window->message_ns = window->now_ns;
	window->must_show = true;
}

static double aspect_of(const struct window *window)
{
	return (double)window->target.width / window->target.height;
}

/* ---- what lies under the cursor ---- */

/* Takes a place in the window system's coordinates; events tell where the cursor was, not where it is. */
static void set_cursor(struct window *window, double x, double y)
{
	int width = 1;
	int height = 1;

	glfwGetWindowSize(window->handle, &width, &height);
	window->cursor[0] = x * window->target.width / (width > 0 ? width : 1);
	window->cursor[1] = y * window->target.height / (height > 0 ? height : 1);
}

/* Distance along the view of what a pixel shows; where it shows nothing, of the world's middle. */
static double distance_at(const struct window *window, const double pixel[2])
{
	float depth = target_read_depth(&window->target, (int)pixel[0], (int)pixel[1]);
	double box_min[3];
	double box_max[3];
	double distance = 0.0;
	struct camera_axes axes;

	if (depth > 0.0f)
		return world_near(&window->show->world) / (double)depth;
	camera_control_axes(&window->camera, &axes);
	if (world_box(&window->show->world, box_min, box_max)) {
		for (int k = 0; k < 3; k++)
			distance += axes.forward[k] *
				    (0.5 * (box_min[k] + box_max[k]) - window->camera.eye[k]);
	}
	return distance > 0.0 ? distance : camera_control_distance(&window->camera);
}

static void point_under_cursor(const struct window *window, double ret[3])
{
	double x = 2.0 * window->cursor[0] / window->target.width - 1.0;
	double y = 1.0 - 2.0 * window->cursor[1] / window->target.height;

	camera_control_point(&window->camera, aspect_of(window), x, y,
			     distance_at(window, window->cursor), ret);
}

static void pick(struct window *window)
{
	struct world *world = &window->show->world;
	struct why why = { "" };
	uint64_t item = frame_pick(window->show->frame, &window->target, CHANNEL_PART,
				   (int)window->cursor[0], (int)window->cursor[1]);
	uint32_t store = (uint32_t)(item >> 32);
	char line[WINDOW_TEXT_MESSAGE_BYTES];

	if (item == CHANNEL_ITEM_NONE || store >= world->store_count) {
		window->message_ns = 0;
		window->must_show = true;
		return;
	}
	if (part_names_describe(&window->part_names[store], world->stores[store].path,
				(uint32_t)item, line, sizeof(line), &why) < 0)
		say(window, "part %u: %s", (uint32_t)item, why.text);
	else
		say(window, "%s", line);
}

/* ---- keys ---- */

static const struct {
	int key;
	enum gesture_motion motion;
} motion_keys[] = {
	{ GLFW_KEY_W, GESTURE_FORWARD },
	{ GLFW_KEY_S, GESTURE_BACKWARD },
	{ GLFW_KEY_A, GESTURE_TO_LEFT },
	{ GLFW_KEY_D, GESTURE_TO_RIGHT },
	{ GLFW_KEY_R, GESTURE_RISE },
	{ GLFW_KEY_F, GESTURE_SINK },
	{ GLFW_KEY_LEFT, GESTURE_TURN_LEFT },
	{ GLFW_KEY_RIGHT, GESTURE_TURN_RIGHT },
	{ GLFW_KEY_UP, GESTURE_TURN_UP },
	{ GLFW_KEY_DOWN, GESTURE_TURN_DOWN },
	{ GLFW_KEY_Z, GESTURE_ROLL_LEFT },
	{ GLFW_KEY_X, GESTURE_ROLL_RIGHT },
	{ GLFW_KEY_LEFT_SHIFT, GESTURE_FASTER },
	{ GLFW_KEY_RIGHT_SHIFT, GESTURE_FASTER },
	{ GLFW_KEY_LEFT_ALT, GESTURE_SLOWER },
	{ GLFW_KEY_RIGHT_ALT, GESTURE_SLOWER },
};

static void view_side(struct window *window, enum camera_control_side side)
{
	double box_min[3];
	double box_max[3];

	if (!world_box(&window->show->world, box_min, box_max))
		return;
	camera_control_view_side(&window->camera, side, window->gesture.up, box_min, box_max,
				 aspect_of(window));
	say(window, "%s", camera_control_side_name(side));
	window->must_draw = true;
}

static void copy_camera(struct window *window)
{
	char row[CAMERA_ROW_BYTES];

	glfwSetClipboardString(window->handle, camera_to_row(&window->camera, row));
	say(window, "camera copied");
}

static void paste_camera(struct window *window)
{
	const char *text = glfwGetClipboardString(window->handle);
	struct why why = { "" };
	struct camera camera;

	if (!text)
		say(window, "the clipboard has no text");
	else if (camera_from_row(&camera, text, &why) < 0)
		say(window, "the clipboard has no camera: %s", why.text);
	else {
		window->camera = camera;
		window->must_draw = true;
		say(window, "camera pasted");
	}
}

/* A name in the current folder that is not taken: of the time, and a number within a second. */
static void name_screenshot(char *path, size_t path_bytes)
{
	char stamp[32];
	time_t now = time(NULL);
	struct tm local;

	(void)strftime(stamp, sizeof(stamp), "%Y%m%d-%H%M%S", localtime_r(&now, &local));
	(void)snprintf(path, path_bytes, "oocview-%s.png", stamp);
	for (int i = 2; access(path, F_OK) == 0; i++)
		(void)snprintf(path, path_bytes, "oocview-%s-%d.png", stamp, i);
}

static void take_screenshot(struct window *window)
{
	const struct options *options = window->show->options;
	struct picture_size size = { window->target.width, window->target.height };
	struct frame_report report;
	struct why why = { "" };
	char path[64];

	if (options->has_size)
		size = options->size;
	name_screenshot(path, sizeof(path));
	if (picture_take(&window->show->picture, window->show->frame, &window->show->world,
			 &window->camera, &window->style, size, options->is_settled, path, &report,
			 &why) < 0)
		say(window, "no picture: %s", why.text);
	else
		say(window, "%s, %ux%u", path, size.width, size.height);
	/* The view's aspect was the picture's. */
	window->must_draw = true;
}

static void change_budget(struct window *window, double factor)
{
	double budget = (double)window->style.choice.budget_triangles * factor;

	budget = fmin(fmax(budget, (double)BUDGET_MIN), (double)BUDGET_MAX);
	window->style.choice.budget_triangles = (uint64_t)llrint(budget);
	/* From here on the budget is a person's. */
	window->show->pace.fps = 0.0;
	window->style.choice.mode = WORLD_MODE_APPROXIMATE;
	window->must_draw = true;
}

static void change_mode(struct window *window)
{
	static const enum world_mode next[] = {
		[WORLD_MODE_FULL] = WORLD_MODE_APPROXIMATE,
		[WORLD_MODE_APPROXIMATE] = WORLD_MODE_CONSERVATIVE,
		[WORLD_MODE_CONSERVATIVE] = WORLD_MODE_FULL,
	};

	window->style.choice.mode = next[window->style.choice.mode];
	window->must_draw = true;
}

static void toggle_playing(struct window *window)
{
	const struct options *options = window->show->options;

	if (!options->has_path) {
		say(window, "there is no path: --path names one");
		return;
	}
	window->is_playing = !window->is_playing;
	if (window->play_frame >= (size_t)options->path_count * options->repeat_count)
		window->play_frame = 0;
	window->play_begin_ns = 0;
}

/* From above, one colouring after the other, and none again. */
static void change_map(struct window *window)
{
	if (!window->cache_view &&
	    cache_view_create(&window->show->world, &window->cache_view, &window->why) < 0) {
		say(window, "%s", window->why.text);
		return;
	}
	window->map = (window->map + 1) % (1 + BIRDS_EYE_COLOURING_COUNT_);
	if (window->map > 0)
		say(window, "the cache by %s", birds_eye_colourings[window->map - 1]);
}

static void on_key_pressed(struct window *window, int key, int modifiers)
{
	switch (key) {
	case GLFW_KEY_Q:
	case GLFW_KEY_ESCAPE:
		glfwSetWindowShouldClose(window->handle, GLFW_TRUE);
		break;
	case GLFW_KEY_H:
	case GLFW_KEY_F1:
		window->shows_help = !window->shows_help;
		break;
	case GLFW_KEY_B:
		change_map(window);
		break;
	case GLFW_KEY_T:
		window->hides_hud = !window->hides_hud;
		break;
	case GLFW_KEY_HOME:
	case GLFW_KEY_0:
		world_frame_all(&window->show->world, aspect_of(window),
				window->camera.fov_y_degrees, &window->camera);
		window->must_draw = true;
		break;
	case GLFW_KEY_1:
	case GLFW_KEY_2:
	case GLFW_KEY_3:
	case GLFW_KEY_4:
	case GLFW_KEY_5:
	case GLFW_KEY_6:
		view_side(window, (enum camera_control_side)(key - GLFW_KEY_1));
		break;
	case GLFW_KEY_G:
		window->gesture.is_walking = !window->gesture.is_walking;
		say(window, window->gesture.is_walking ? "walking" : "flying");
		break;
	case GLFW_KEY_L:
		camera_control_level(&window->camera, window->gesture.up);
		window->must_draw = true;
		break;
	case GLFW_KEY_U:
		window->style.unlit = !window->style.unlit;
		window->must_draw = true;
		break;
	case GLFW_KEY_M:
		change_mode(window);
		break;
	case GLFW_KEY_EQUAL:
	case GLFW_KEY_KP_ADD:
		change_budget(window, 1.5);
		break;
	case GLFW_KEY_MINUS:
	case GLFW_KEY_KP_SUBTRACT:
		change_budget(window, 1.0 / 1.5);
		break;
	case GLFW_KEY_P:
		take_screenshot(window);
		break;
	case GLFW_KEY_SPACE:
		toggle_playing(window);
		break;
	case GLFW_KEY_C:
		if (modifiers & GLFW_MOD_CONTROL)
			copy_camera(window);
		break;
	case GLFW_KEY_V:
		if (modifiers & GLFW_MOD_CONTROL)
			paste_camera(window);
		break;
	default:
		break;
	}
	window->must_show = true;
}

/* ---- callbacks ---- */

static struct window *window_of(GLFWwindow *handle)
{
	return glfwGetWindowUserPointer(handle);
}

static void on_key(GLFWwindow *handle, int key, int scancode, int action, int modifiers)
{
	struct window *window = window_of(handle);

	(void)scancode;
	for (size_t i = 0; i < ARRAY_LENGTH(motion_keys); i++) {
		if (motion_keys[i].key == key)
			window->gesture.held[motion_keys[i].motion] = action != GLFW_RELEASE;
	}
	if (action == GLFW_PRESS)
		on_key_pressed(window, key, modifiers);
}

static enum gesture_drag drag_of(int button, int modifiers)
{
	if (button == GLFW_MOUSE_BUTTON_LEFT)
		return modifiers & GLFW_MOD_SHIFT ? GESTURE_PAN : GESTURE_ORBIT;
	if (button == GLFW_MOUSE_BUTTON_MIDDLE)
		return GESTURE_PAN;
	return button == GLFW_MOUSE_BUTTON_RIGHT ? GESTURE_LOOK : GESTURE_NO_DRAG;
}

static void on_button(GLFWwindow *handle, int button, int action, int modifiers)
{
	struct window *window = window_of(handle);
	double point[3];

	if (action == GLFW_PRESS) {
		point_under_cursor(window, point);
		gesture_press(&window->gesture, drag_of(button, modifiers), window->cursor[0],
			      window->cursor[1], point);
	} else if (gesture_release(&window->gesture) && button == GLFW_MOUSE_BUTTON_LEFT) {
		pick(window);
	}
}

static void on_cursor(GLFWwindow *handle, double x, double y)
{
	struct window *window = window_of(handle);

	set_cursor(window, x, y);
	if (gesture_move(&window->gesture, &window->camera, window->cursor[0], window->cursor[1],
			 window->target.height))
		window->must_draw = true;
}

static void on_wheel(GLFWwindow *handle, double right, double away)
{
	struct window *window = window_of(handle);
	double point[3];

	(void)right;
	point_under_cursor(window, point);
	gesture_wheel(&window->camera, point, away);
	window->must_draw = true;
}

static void on_damage(GLFWwindow *handle)
{
	window_of(handle)->must_show = true;
}

static void on_focus(GLFWwindow *handle, int is_focused)
{
	/* Releases that happen elsewhere are not told. */
	if (!is_focused)
		memset(window_of(handle)->gesture.held, 0, sizeof(window_of(handle)->gesture.held));
}

/* ---- the loop ---- */

/* Makes the target as large as the window.  Returns: 0, or -ENOMEM. */
static int fit_target(struct window *window)
{
	int width;
	int height;

	glfwGetFramebufferSize(window->handle, &width, &height);
	/* A window that is put away has no size. */
	if (width <= 0 || height <= 0)
		return 0;
	if (window->target.framebuffer && window->target.width == (uint32_t)width &&
	    window->target.height == (uint32_t)height)
		return 0;
	target_done(&window->target);
	window->must_draw = true;
	return target_init(&window->target, (uint32_t)width, (uint32_t)height, CHANNEL_COLOUR,
			   &window->why);
}

static int draw(struct window *window)
{
	struct show *show = window->show;
	uint64_t begin_ns = clock_now_ns();
	struct ooc_progress progress;
	bool is_settled = window->is_playing && show->options->is_settled;
	int r;

	show_set_budget(show, window->target.width, window->target.height, &window->style);
	if (!window->is_playing)
		window->camera.time_s =
			(double)(window->now_ns - window->begin_ns) / (double)NS_PER_S;

	if (is_settled)
		r = frame_draw_settled(show->frame, &window->camera, aspect_of(window),
				       &window->style, &render_tile_whole, &window->target,
				       &window->report, &window->why);
	else
		r = frame_draw_live(show->frame, &window->camera, aspect_of(window), &window->style,
				    &window->target, &window->report, &window->why);
	if (r < 0)
		return r;
	/* What was overwritten while it was drawn is drawn again, and so is what comes in pieces. */
	window->must_draw = !frame_finish(show->frame) || window->report.is_unfinished;
	window->report.ms = (double)(clock_now_ns() - begin_ns) / (double)NS_PER_MS;
	window->must_show = true;
	ooc_progress(show->world.client, &progress);
	window->drawable_count = progress.drawable_count;
	window_rate_add(&window->rate, window->now_ns,
			window->report.bytes_fetched + window->report.bytes_prefetched);
	return show_add(show,
			&(struct show_frame){ &window->camera, aspect_of(window), &window->style,
					      &window->report },
			&window->why);
}

static void add_texts(struct window *window)
{
	const struct world *world = &window->show->world;
	char text[WINDOW_TEXT_BYTES];

	if (!window->hides_hud && !window->shows_help) {
		const struct window_text_facts facts = {
			.world = world,
			.style = &window->style,
			.report = &window->report,
			.bytes_per_s = window_rate_get(&window->rate, window->now_ns),
			.is_walking = window->gesture.is_walking,
			.fps = window->show->pace.fps,
		};

		window->shows_rate = facts.bytes_per_s > 0.0;
		hud_add(window->hud, HUD_TOP_LEFT, window_text_state(&facts, text));
	}
	if (window->message_ns)
		hud_add(window->hud, HUD_BOTTOM_LEFT, window->message);
	if (window->shows_help)
		hud_add(window->hud, HUD_CENTRE, window_text_help);
}

static void present(struct window *window)
{
	GLint width = (GLint)window->target.width;
	GLint height = (GLint)window->target.height;

	glBlitNamedFramebuffer(window->target.framebuffer, 0, 0, 0, width, height, 0, 0, width,
			       height, GL_COLOR_BUFFER_BIT, GL_NEAREST);
	if (window->map > 0)
		cache_view_draw(window->cache_view, &window->camera, window->show->foresight,
				(enum birds_eye_colouring)(window->map - 1), window->target.width,
				window->target.height);
	add_texts(window);
	hud_draw(window->hud, window->target.width, window->target.height);
	glfwSwapBuffers(window->handle);
	window->must_show = false;
	window->shown_ns = window->now_ns;
}

/* Moves on along the path, when it is time. */
static int play(struct window *window)
{
	struct show *show = window->show;
	const struct options *options = show->options;
	const size_t frame_count = (size_t)options->path_count * options->repeat_count;
	size_t row = window->play_frame % options->path_count;
	double due_s = options->path[row].time_s - options->path[0].time_s;
	char *path = NULL;
	int r = 0;

	if (row == 0 || window->play_begin_ns == 0) {
		/* From here on, the time of the path is the time of the clock. */
		window->play_begin_ns =
			window->now_ns - (uint64_t)llrint(fmax(due_s, 0.0) * (double)NS_PER_S);
	} else if ((double)(window->now_ns - window->play_begin_ns) < due_s * (double)NS_PER_S) {
		return 0;
	}
	window->camera = options->path[row];
	window->must_draw = true;
	window->play_frame++;
	if (options->frames_folder) {
		struct frame_report report;

		r = show_frame_path(options->frames_folder, window->frames_written++, &path,
				    &window->why);
		if (r == 0)
			r = picture_take(&show->picture, show->frame, &show->world, &window->camera,
					 &window->style, options->size, options->is_settled, path,
					 &report, &window->why);
		free(path);
	}
	if (window->play_frame == frame_count)
		window->is_playing = false;
	return r;
}

/* Keys that are held move the camera. */
static void step(struct window *window, uint64_t before_ns)
{
	double seconds = (double)(window->now_ns - before_ns) / (double)NS_PER_S;
	const double middle[2] = { window->target.width / 2.0, window->target.height / 2.0 };

	if (gesture_is_moving(&window->gesture) &&
	    gesture_step(&window->gesture, &window->camera, fmin(seconds, STEP_S_MAX),
			 distance_at(window, middle)))
		window->must_draw = true;
}

/* Has anything come that the picture shown has not? */
static void look_for_news(struct window *window)
{
	struct world *world = &window->show->world;
	struct ooc_progress progress;

	world_dispatch(world);
	ooc_progress(world->client, &progress);
	if (progress.drawable_count != window->drawable_count)
		window->must_draw = true;
}

static void wait_for_events(struct window *window)
{
	if (window->must_draw || window->is_playing || gesture_is_moving(&window->gesture))
		glfwPollEvents();
	else if (window->report.nodes_missing > 0)
		glfwWaitEventsTimeout(MISSING_WAIT_S);
	else
		glfwWaitEventsTimeout(IDLE_WAIT_S);
}

/* The picture that --screenshot asks for, once the path is at its end.  Returns: 1: the end. */
static int take_last_picture(struct window *window)
{
	struct show *show = window->show;
	const struct options *options = show->options;
	struct frame_report report;
	int r;

	if (window->is_playing || !options_is_bounded(options))
		return 0;
	/* Without --settle the picture is of what has come when nothing more is missing. */
	if (!options->has_path && window->report.nodes_missing > 0 && !options->is_settled)
		return 0;
	if (!options->screenshot_path)
		return 1;
	r = picture_take(&show->picture, show->frame, &show->world, &window->camera, &window->style,
			 options->size, options->is_settled, options->screenshot_path, &report,
			 &window->why);
	return r < 0 ? r : 1;
}

static int turn_of_loop(struct window *window)
{
	uint64_t before_ns = window->now_ns;
	int r;

	wait_for_events(window);
	window->now_ns = clock_now_ns();
	step(window, before_ns);
	if (window->is_playing) {
		r = play(window);
		if (r < 0)
			return r;
	}
	if (window->message_ns && window->now_ns - window->message_ns > MESSAGE_NS) {
		window->message_ns = 0;
		window->must_show = true;
	}
	if ((window->shows_rate || window->map > 0) && window->now_ns - window->shown_ns > RATE_NS)
		window->must_show = true;
	look_for_news(window);
	r = fit_target(window);
	if (r == 0 && window->must_draw)
		r = draw(window);
	if (r == 0 && window->must_show)
		present(window);
	return r < 0 ? r : take_last_picture(window);
}

static int begin(struct window *window)
{
	struct show *show = window->show;
	double box_min[3];
	double box_max[3];
	double size2 = 0.0;
	double x;
	double y;
	int r;

	window->handle = surface_window(show->surface);
	window->style = show->options->style;
	window->now_ns = clock_now_ns();
	window->begin_ns = window->now_ns;
	r = hud_create(&window->hud, &window->why);
	if (r == 0)
		r = fit_target(window);
	if (r < 0)
		return r;
	if (!window->target.framebuffer)
		return why_set(&window->why, -ENODEV, "the window has no size");
	world_up(&show->world, window->gesture.up);
	if (world_box(&show->world, box_min, box_max)) {
		for (int k = 0; k < 3; k++)
			size2 += (box_max[k] - box_min[k]) * (box_max[k] - box_min[k]);
	}
	window->gesture.scene_size = sqrt(size2);
	show_first_camera(show, aspect_of(window), &window->camera);
	glfwGetCursorPos(window->handle, &x, &y);
	set_cursor(window, x, y);
	window->is_playing = show->options->has_path;
	window->must_draw = true;
	glfwSetWindowUserPointer(window->handle, window);
	glfwSetKeyCallback(window->handle, on_key);
	glfwSetMouseButtonCallback(window->handle, on_button);
	glfwSetCursorPosCallback(window->handle, on_cursor);
	glfwSetScrollCallback(window->handle, on_wheel);
	glfwSetWindowRefreshCallback(window->handle, on_damage);
	glfwSetWindowFocusCallback(window->handle, on_focus);
	return 0;
}

int window_run(struct show *show, struct why *why)
{
	struct window *window = calloc(1, sizeof(*window));
	int r;

	if (!window)
		return why_errno(why, -ENOMEM, "a window");
	window->show = show;
	r = begin(window);
	while (r == 0 && !stop_requested() && !glfwWindowShouldClose(window->handle))
		r = turn_of_loop(window);
	/* A person who ends a film, ends it. */
	if (r == -ECANCELED)
		r = 0;
	if (r < 0)
		*why = window->why;
	for (size_t i = 0; i < WORLD_STORE_COUNT_MAX; i++)
		part_names_done(&window->part_names[i]);
	target_done(&window->target);
	cache_view_destroy(window->cache_view);
	hud_destroy(window->hud);
	free(window);
	return r < 0 ? r : 0;
}
