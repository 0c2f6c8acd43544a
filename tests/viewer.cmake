# SPDX-License-Identifier: MIT
oocd_test(test_camera_control unit
	SOURCES unit/test_camera_control.c LINK oocd_view oocd_test_helper m)
oocd_test(test_image unit SOURCES unit/test_image.c LINK oocd_view oocd_test_helper)
