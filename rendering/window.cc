#include "rendering/window.h"

#include <EGL/egl.h>
#include <EGL/eglext.h>
#include <vtkAutoInit.h>
#include <vtkGenericOpenGLRenderWindow.h>
#include <vtkJPEGWriter.h>
#include <vtkLogger.h>
#include <vtkNew.h>
#include <vtkObject.h>
#include <vtkPNGWriter.h>
#include <vtkUnsignedCharArray.h>
#include <vtkWindowToImageFilter.h>

#include <mutex>

#include "core/file.h"

VTK_MODULE_INIT(vtkRenderingOpenGL2)
VTK_MODULE_INIT(vtkRenderingFreeType)
VTK_MODULE_INIT(vtkRenderingContextOpenGL2)
VTK_MODULE_INIT(vtkInteractionStyle)

namespace gnathion {
namespace {

/// The process's one OpenGL context that belongs to no window; lives until the process ends.
struct WindowlessContext {
  EGLDisplay display = EGL_NO_DISPLAY;
  EGLContext context = EGL_NO_CONTEXT;
};

WindowlessContext make_context() {
  WindowlessContext made;
  const auto get_display =
      reinterpret_cast<PFNEGLGETPLATFORMDISPLAYEXTPROC>(eglGetProcAddress("eglGetPlatformDisplayEXT"));
  if (!get_display) return made;
  made.display = get_display(EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY, nullptr);
  if (!eglInitialize(made.display, nullptr, nullptr) || !eglBindAPI(EGL_OPENGL_API)) return made;
  const EGLint wanted[] = {EGL_CONTEXT_MAJOR_VERSION,
                           3,
                           EGL_CONTEXT_MINOR_VERSION,
                           2,
                           EGL_CONTEXT_OPENGL_PROFILE_MASK,
                           EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT,
                           EGL_NONE};
  // No surface is ever made, so no framebuffer configuration is needed (EGL_KHR_no_config_context).
  made.context = eglCreateContext(made.display, EGL_NO_CONFIG_KHR, EGL_NO_CONTEXT, wanted);
  return made;
}

const WindowlessContext& the_context() {
  static const WindowlessContext context = make_context();
  return context;
}

bool use_context() {
  // The API is a thread's own; Mesa takes OpenGL ES unless told otherwise.
  const WindowlessContext& c = the_context();
  return c.context != EGL_NO_CONTEXT && eglBindAPI(EGL_OPENGL_API) &&
         eglMakeCurrent(c.display, EGL_NO_SURFACE, EGL_NO_SURFACE, c.context);
}

std::mutex& turns() {
  static std::mutex mutex;
  return mutex;
}

}  // namespace

DrawingTurn::DrawingTurn() {
  turns().lock();
}

DrawingTurn::~DrawingTurn() {
  const WindowlessContext& c = the_context();
  if (c.context != EGL_NO_CONTEXT) eglMakeCurrent(c.display, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
  turns().unlock();
}

Result<vtkSmartPointer<vtkRenderWindow>> offscreen_window(int width_px, int height_px) {
  // VTK's loader complains that there is no GLX display; the functions it needs are there all the same.
  vtkLogger::SetStderrVerbosity(vtkLogger::VERBOSITY_OFF);
  vtkObject::GlobalWarningDisplayOff();
  if (!use_context())
    return fail(ErrorCode::kInternal, "cannot draw", "OpenGL",
                "no surfaceless EGL context (Mesa's libgl1-mesa-dri)");
  auto window = vtkSmartPointer<vtkGenericOpenGLRenderWindow>::New();
  window->SetOwnContext(false);
  window->SetReadyForRendering(true);
  window->SetSupportsOpenGL(1);
  window->SetIsCurrent(true);
  window->SetOffScreenRendering(true);
  window->SetMultiSamples(0);  // far faster in software; edges are smoothed by FXAA
  window->SetSize(width_px, height_px);
  return vtkSmartPointer<vtkRenderWindow>(window);
}

namespace {

/// What the window shows, through one of VTK's writers.
template <class Writer>
Result<std::string> written(vtkRenderWindow& window, Writer& writer) {
  vtkNew<vtkWindowToImageFilter> grab;
  grab->SetInput(&window);
  grab->SetInputBufferTypeToRGB();
  grab->ReadFrontBufferOff();
  grab->ShouldRerenderOff();
  writer.SetInputConnection(grab->GetOutputPort());
  writer.WriteToMemoryOn();
  writer.Write();
  vtkUnsignedCharArray* bytes = writer.GetResult();
  if (!bytes || bytes->GetNumberOfValues() == 0)
    return fail(ErrorCode::kInternal, "cannot draw", "picture", "nothing came out of the renderer");
  return std::string(reinterpret_cast<const char*>(bytes->GetPointer(0)),
                     static_cast<std::size_t>(bytes->GetNumberOfValues()));
}

}  // namespace

Result<std::string> window_png(vtkRenderWindow& window) {
  window.Render();
  vtkNew<vtkPNGWriter> writer;
  return written(window, *writer);
}

Result<std::string> window_jpeg(vtkRenderWindow& window) {
  vtkNew<vtkJPEGWriter> writer;
  writer->SetQuality(88);
  return written(window, *writer);
}

Status save_window(vtkRenderWindow& window, const std::filesystem::path& png) {
  GNATHION_TRY(const std::string bytes, window_png(window));
  return write_file(png, bytes);
}

}  // namespace gnathion
