/* SPDX-License-Identifier: MIT */
#include "viewer/surface.h"

#include <errno.h>
#include <malloc.h>
#include <stdlib.h>

#include <epoxy/egl.h>
#include <epoxy/gl.h>

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>

#include "formats/base/log.h"

#define HEAP_KEPT_BYTES (64 << 20)

#define CONTEXT_MAJOR 4
#define CONTEXT_MINOR 5

struct surface {
	GLFWwindow *window; /* NULL when headless */
	EGLDisplay display; /* EGL_NO_DISPLAY with a window: GLFW has its own */
	EGLContext context;
};

static const char need_gl[] =
	"OpenGL 4.5 is needed; Mesa's software renderer has it (package libgl1-mesa-dri)";

#ifdef OOCD_DEBUG
static void GLAPIENTRY on_gl_message(GLenum source, GLenum type, GLuint id, GLenum severity,
				     GLsizei length, const GLchar *message, const void *arg)
{
	(void)source;
	(void)id;
	(void)severity;
	(void)length;
	(void)arg;
	if (type == GL_DEBUG_TYPE_ERROR || type == GL_DEBUG_TYPE_UNDEFINED_BEHAVIOR)
		log_error("bug: OpenGL says: %s", message);
}
#endif

static int set_up_state(struct why *why)
{
	if (epoxy_gl_version() < CONTEXT_MAJOR * 10 + CONTEXT_MINOR)
		return why_set(why, -ENODEV, "%s has OpenGL %d.%d: %s",
			       (const char *)glGetString(GL_RENDERER), epoxy_gl_version() / 10,
			       epoxy_gl_version() % 10, need_gl);
#ifdef OOCD_DEBUG
	glEnable(GL_DEBUG_OUTPUT);
	glDebugMessageCallback(on_gl_message, NULL);
#endif
	glClipControl(GL_LOWER_LEFT, GL_ZERO_TO_ONE);
	glDepthFunc(GL_GREATER);
	glClearDepth(0.0);
	glPixelStorei(GL_PACK_ALIGNMENT, 1);
	glPixelStorei(GL_UNPACK_ALIGNMENT, 1);
	return 0;
}

static int open_window(struct surface *surface, const char *title, uint32_t width, uint32_t height,
		       struct why *why)
{
	const char *description = NULL;

	if (!glfwInit()) {
		(void)glfwGetError(&description);
		return why_set(why, -ENODEV,
			       "no window can be opened: %s; --headless needs no display",
			       description ? description : "no display");
	}
	glfwWindowHint(GLFW_CONTEXT_CREATION_API, GLFW_EGL_CONTEXT_API);
	glfwWindowHint(GLFW_CLIENT_API, GLFW_OPENGL_API);
	glfwWindowHint(GLFW_CONTEXT_VERSION_MAJOR, CONTEXT_MAJOR);
	glfwWindowHint(GLFW_CONTEXT_VERSION_MINOR, CONTEXT_MINOR);
	glfwWindowHint(GLFW_OPENGL_PROFILE, GLFW_OPENGL_CORE_PROFILE);
	glfwWindowHint(GLFW_DEPTH_BITS, 0);
	glfwWindowHint(GLFW_STENCIL_BITS, 0);
	surface->window = glfwCreateWindow((int)width, (int)height, title, NULL, NULL);
	if (!surface->window) {
		(void)glfwGetError(&description);
		return why_set(why, -ENODEV, "no OpenGL window: %s; %s",
			       description ? description : "no reason given", need_gl);
	}
	glfwMakeContextCurrent(surface->window);
	glfwSwapInterval(1);
	return set_up_state(why);
}

static int open_headless(struct surface *surface, struct why *why)
{
	static const EGLint config_wanted[] = { EGL_SURFACE_TYPE, 0, EGL_RENDERABLE_TYPE,
						EGL_OPENGL_BIT, EGL_NONE };
	static const EGLint context_wanted[] = { EGL_CONTEXT_MAJOR_VERSION,
						 CONTEXT_MAJOR,
						 EGL_CONTEXT_MINOR_VERSION,
						 CONTEXT_MINOR,
						 EGL_CONTEXT_OPENGL_PROFILE_MASK,
						 EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT,
						 EGL_NONE };
	EGLConfig config = EGL_NO_CONFIG_KHR;
	EGLint config_count = 0;

	if (!epoxy_has_egl() ||
	    !epoxy_has_egl_extension(EGL_NO_DISPLAY, "EGL_MESA_platform_surfaceless"))
		return why_set(why, -ENODEV, "EGL has no surfaceless platform here: %s", need_gl);
	/* Not eglGetPlatformDisplay(): epoxy resolves the core name only once EGL is initialised. */
	surface->display =
		eglGetPlatformDisplayEXT(EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY, NULL);
	if (surface->display == EGL_NO_DISPLAY || !eglInitialize(surface->display, NULL, NULL))
		return why_set(why, -ENODEV, "EGL does not start: %s", need_gl);
	if (!eglBindAPI(EGL_OPENGL_API))
		return why_set(why, -ENODEV, "EGL has no desktop OpenGL here: %s", need_gl);
	/* Without a surface a context needs no config, and some drivers offer none for it. */
	if (!eglChooseConfig(surface->display, config_wanted, &config, 1, &config_count) ||
	    config_count == 0)
		config = EGL_NO_CONFIG_KHR;
	surface->context =
		eglCreateContext(surface->display, config, EGL_NO_CONTEXT, context_wanted);
	if (surface->context == EGL_NO_CONTEXT ||
	    !eglMakeCurrent(surface->display, EGL_NO_SURFACE, EGL_NO_SURFACE, surface->context))
		return why_set(why, -ENODEV, "%s", need_gl);
	return set_up_state(why);
}

static struct surface *surface_allocate(void)
{
	struct surface *surface = calloc(1, sizeof(*surface));

	if (!surface)
		return NULL;
	surface->display = EGL_NO_DISPLAY;
	surface->context = EGL_NO_CONTEXT;
	/* Mesa tells of each driver that it tries; what matters is said by us. */
	(void)setenv("EGL_LOG_LEVEL", "fatal", 0);
	/*
	 * A software renderer allocates and frees some tens of MiB a frame: handing them back to the
	 * kernel each time, and having them zeroed again, took a tenth of its time.
	 */
	(void)mallopt(M_TRIM_THRESHOLD, HEAP_KEPT_BYTES);
	return surface;
}

int surface_open_window(const char *title, uint32_t width, uint32_t height, struct surface **ret,
			struct why *why)
{
	struct surface *surface = surface_allocate();
	int r;

	if (!surface)
		return why_errno(why, -ENOMEM, "a window");
	r = open_window(surface, title, width, height, why);
	if (r < 0) {
		surface_close(surface);
		return r;
	}
	*ret = surface;
	return 0;
}

int surface_open_headless(struct surface **ret, struct why *why)
{
	struct surface *surface = surface_allocate();
	int r;

	if (!surface)
		return why_errno(why, -ENOMEM, "an OpenGL context");
	r = open_headless(surface, why);
	if (r < 0) {
		surface_close(surface);
		return r;
	}
	*ret = surface;
	return 0;
}

struct surface *surface_close(struct surface *surface)
{
	if (!surface)
		return NULL;
	if (surface->window)
		glfwDestroyWindow(surface->window);
	/*
	 * No eglTerminate(): it unloads Mesa's driver, which leaves two small blocks behind that a leak
	 * checker then counts as ours.  The display ends with the process.
	 */
	if (surface->display != EGL_NO_DISPLAY) {
		(void)eglMakeCurrent(surface->display, EGL_NO_SURFACE, EGL_NO_SURFACE,
				     EGL_NO_CONTEXT);
		if (surface->context != EGL_NO_CONTEXT)
			(void)eglDestroyContext(surface->display, surface->context);
	} else {
		glfwTerminate();
	}
	free(surface);
	return NULL;
}

GLFWwindow *surface_window(const struct surface *surface)
{
	return surface->window;
}

const char *surface_renderer(const struct surface *surface)
{
	(void)surface;
	return (const char *)glGetString(GL_RENDERER);
}
