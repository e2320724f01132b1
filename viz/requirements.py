"""Checks of the packages and libraries that viewers need; VTK crashes without them."""

from __future__ import annotations

import ctypes
import os
import sys
from importlib.util import find_spec

from ..errors import ConfigError

EXTRA = "pip install 'spmm_torch[viz]'"
# The variable that names VTK's window class; without it VTK tries a screen first and warns.
WINDOW_CLASS = "VTK_DEFAULT_OPENGL_WINDOW"
# Libraries that draw without a screen; one of them is enough.
X11 = "libX11.so.6"  # by which windows are opened
EGL, OSMESA = "libEGL.so.1", ("libOSMesa.so.8", "libOSMesa.so.6")
# The C interface of EGL: EGL_PLATFORM_DEVICE_EXT, most devices, and types of two functions.
PLATFORM_DEVICE, MAX_DEVICES = 0x313F, 16
QUERY_DEVICES = ctypes.CFUNCTYPE(
    ctypes.c_uint, ctypes.c_int, ctypes.POINTER(ctypes.c_void_p), ctypes.POINTER(ctypes.c_int)
)
PLATFORM_DISPLAY = ctypes.CFUNCTYPE(
    ctypes.c_void_p, ctypes.c_uint, ctypes.c_void_p, ctypes.c_void_p
)


def require_packages(command: str, *names: str) -> None:
    """Checks that the packages of the extra `viz` are installed.

    Raises:
        ConfigError: a package is missing.
    """
    missing = [name for name in names if find_spec(name) is None]
    if missing:
        raise ConfigError(
            f"{command} needs {missing[0]}, which is not installed; install it with {EXTRA}."
        )


def use_offscreen(command: str) -> None:
    """Makes VTK draw without a screen in this process: by EGL, or else by OSMesa.

    Raises:
        ConfigError: neither works on this machine.
    """
    if sys.platform != "linux":
        return
    if egl_works():
        os.environ[WINDOW_CLASS] = "vtkEGLRenderWindow"
    elif any(map(can_load, OSMESA)):
        os.environ[WINDOW_CLASS] = "vtkOSOpenGLRenderWindow"
    else:
        raise ConfigError(
            f"{command} cannot draw: neither EGL nor OSMesa works on this machine; expected one "
            f"of them; install the Debian package libegl1, or libosmesa6."
        )


def require_window(command: str) -> None:
    """Checks that a window can be opened.

    Raises:
        ConfigError: there is no display.
    """
    if sys.platform != "linux" or display_works():
        return
    name = os.environ.get("DISPLAY")
    reason = f"nothing answers at DISPLAY={name}" if name else "DISPLAY is not set"
    raise ConfigError(
        f"{command} finds no display ({reason}); expected one for a window; give "
        f"--save PICTURE.png or --html FILE.html instead."
    )


def display_works() -> bool:
    """Whether an X server answers; VTK ends without a window and without a word where none does."""
    if not os.environ.get("DISPLAY") or not can_load(X11):
        return False
    library = ctypes.CDLL(X11)
    library.XOpenDisplay.restype = ctypes.c_void_p
    library.XOpenDisplay.argtypes = library.XCloseDisplay.argtypes = [ctypes.c_void_p]
    display = library.XOpenDisplay(None)
    if display:
        library.XCloseDisplay(display)
    return bool(display)


def can_load(library: str) -> bool:
    """Whether the dynamic loader finds a library."""
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def egl_works() -> bool:
    """Whether EGL is installed and one of its devices starts; without, VTK aborts the process.

    Devices are tried as VTK tries them: by EGL_EXT_device_base and EGL_EXT_platform_device.
    """
    if not can_load(EGL):
        return False
    egl = ctypes.CDLL(EGL)
    egl.eglGetProcAddress.restype = ctypes.c_void_p
    egl.eglGetProcAddress.argtypes = [ctypes.c_char_p]
    egl.eglInitialize.argtypes = [ctypes.c_void_p] * 3
    query = egl.eglGetProcAddress(b"eglQueryDevicesEXT")
    display_of = egl.eglGetProcAddress(b"eglGetPlatformDisplayEXT")
    if not query or not display_of:
        return False
    devices, count = (ctypes.c_void_p * MAX_DEVICES)(), ctypes.c_int()
    QUERY_DEVICES(query)(MAX_DEVICES, devices, ctypes.byref(count))
    displays = [
        PLATFORM_DISPLAY(display_of)(PLATFORM_DEVICE, devices[i], None) for i in range(count.value)
    ]
    return any(display and egl.eglInitialize(display, None, None) for display in displays)
