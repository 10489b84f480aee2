#include "viewer/scene/full_picture.h"

#include <vtkCamera.h>
#include <vtkOpenGLQuadHelper.h>
#include <vtkOpenGLRenderWindow.h>
#include <vtkOpenGLShaderCache.h>
#include <vtkOpenGLState.h>
#include <vtkRenderer.h>
#include <vtkShaderProgram.h>
#include <vtkTextureObject.h>
#include <vtk_glew.h>

namespace gnathion {
namespace {

/// Depth is told anew for the clipping range of the moment, which marks in the scene may have widened.
constexpr const char* kShader = R"(//VTK::System::Dec
in vec2 texCoord;
uniform sampler2D colors;
uniform sampler2D depths;
uniform vec2 drawn_mm;
uniform vec2 now_mm;
//VTK::Output::Dec
void main() {
  gl_FragData[0] = vec4(texture2D(colors, texCoord).rgb, 1.0);
  float depth = texture2D(depths, texCoord).r;
  float away_mm = drawn_mm.x * drawn_mm.y / (drawn_mm.y - depth * (drawn_mm.y - drawn_mm.x));
  float now = now_mm.y / (now_mm.y - now_mm.x) * (1.0 - now_mm.x / away_mm);
  gl_FragDepth = depth >= 1.0 ? 1.0 : clamp(now, 0.0, 1.0);
}
)";

void set_range(vtkShaderProgram& program, const char* name, const double* range_mm) {
  const float values[2] = {static_cast<float>(range_mm[0]), static_cast<float>(range_mm[1])};
  program.SetUniform2f(name, values);
}

}  // namespace

vtkStandardNewMacro(LayerActor);
vtkStandardNewMacro(PictureProp);

PictureProp::PictureProp() = default;
PictureProp::~PictureProp() = default;

CameraPlace place_of(vtkCamera& camera) {
  CameraPlace p;
  camera.GetPosition(p.eye.data());
  camera.GetFocalPoint(p.focus.data());
  camera.GetViewUp(p.up.data());
  p.angle_deg = camera.GetViewAngle();
  return p;
}

void PictureProp::show(std::shared_ptr<const FinishedPicture> picture) {
  if (picture_ == picture) return;
  picture_ = std::move(picture);
  Modified();
}

int PictureProp::RenderOpaqueGeometry(vtkViewport* viewport) {
  auto* renderer = vtkRenderer::SafeDownCast(viewport);
  auto* window = renderer ? vtkOpenGLRenderWindow::SafeDownCast(renderer->GetRenderWindow()) : nullptr;
  if (!picture_ || !window) return 0;
  const auto width = static_cast<unsigned>(picture_->px.width()),
             height = static_cast<unsigned>(picture_->px.height());
  if (loaded_ != picture_) {
    colors_ = vtkSmartPointer<vtkTextureObject>::New();
    depth_ = vtkSmartPointer<vtkTextureObject>::New();
    for (const auto& texture : {colors_, depth_}) {
      texture->SetContext(window);
      texture->SetMinificationFilter(vtkTextureObject::Nearest);
      texture->SetMagnificationFilter(vtkTextureObject::Nearest);
    }
    colors_->Create2DFromRaw(width, height, 4, VTK_UNSIGNED_CHAR,
                             const_cast<std::uint8_t*>(picture_->rgba.data()));
    depth_->Create2DFromRaw(width, height, 1, VTK_FLOAT, const_cast<float*>(picture_->depth.data()));
    loaded_ = picture_;
  }
  vtkOpenGLState* state = window->GetState();
  const vtkOpenGLState::ScopedglEnableDisable depth_test(state, GL_DEPTH_TEST), blend(state, GL_BLEND);
  state->vtkglEnable(GL_DEPTH_TEST);
  state->vtkglDisable(GL_BLEND);
  state->vtkglDepthMask(GL_TRUE);
  state->vtkglDepthFunc(GL_LEQUAL);
  if (!quad_)
    quad_ = std::make_unique<vtkOpenGLQuadHelper>(window, nullptr, kShader, nullptr);
  else
    window->GetShaderCache()->ReadyShaderProgram(quad_->Program);
  if (!quad_->Program) return 0;
  colors_->Activate();
  depth_->Activate();
  quad_->Program->SetUniformi("colors", colors_->GetTextureUnit());
  quad_->Program->SetUniformi("depths", depth_->GetTextureUnit());
  set_range(*quad_->Program, "drawn_mm", picture_->clipping_mm.data());
  set_range(*quad_->Program, "now_mm", renderer->GetActiveCamera()->GetClippingRange());
  quad_->Render();
  colors_->Deactivate();
  depth_->Deactivate();
  return 1;
}

void PictureProp::ReleaseGraphicsResources(vtkWindow* window) {
  quad_.reset();
  for (auto* texture : {&colors_, &depth_})
    if (*texture) (*texture)->ReleaseGraphicsResources(window), *texture = nullptr;
  loaded_.reset();
}

}  // namespace gnathion
