// Off-screen VTK windows and PNG files, without any display; internal to rendering.
#pragma once

#include <filesystem>
#include <string>

#include <vtkSmartPointer.h>

#include "core/result.h"

class vtkRenderWindow;

namespace gnathion {

/// This thread's turn with the process's one OpenGL context; others wait for its end. Windows die before it.
class DrawingTurn {
 public:
  DrawingTurn();
  ~DrawingTurn();
  DrawingTurn(const DrawingTurn&) = delete;
  DrawingTurn& operator=(const DrawingTurn&) = delete;
};

/// A window that draws into memory. Debian's VTK knows only X11 windows, so the OpenGL context comes from
/// Mesa's surfaceless EGL platform and VTK draws into it. One thread at a time in the whole process.
Result<vtkSmartPointer<vtkRenderWindow>> offscreen_window(int width_px, int height_px);
/// Renders; the picture as PNG bytes.
Result<std::string> window_png(vtkRenderWindow& window);
/// The picture that window_png rendered, as JPEG bytes.
Result<std::string> window_jpeg(vtkRenderWindow& window);
/// Renders and writes the window's picture, whole or not at all.
Status save_window(vtkRenderWindow& window, const std::filesystem::path& png);

}  // namespace gnathion
