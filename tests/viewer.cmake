# SPDX-License-Identifier: MIT
oocd_test(test_camera_control unit
	SOURCES unit/test_camera_control.c LINK oocd_view oocd_test_helper m)
oocd_test(test_image unit SOURCES unit/test_image.c LINK oocd_view oocd_test_helper)
oocd_test(test_oocview integration
	SOURCES integration/test_oocview.c LINK oocd_view oocd_daemon_kit TIMEOUT 180 SINGLE_THREADED
	NEEDS oocview oocbuild)
oocd_test(test_window integration
	SOURCES integration/test_window.c LINK oocd_daemon_kit TIMEOUT 180 SINGLE_THREADED
	NEEDS oocview)
