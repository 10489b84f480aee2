// What the finished mesh is, measured on the mesh itself by means that did not make it.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "core/mesh.h"
#include "core/mesh_query.h"
#include "core/transform.h"
#include "design/contact_sigma.h"
#include "design/parameters.h"
#include "design/retention.h"
#include "occlusion/arch.h"
#include "occlusion/clinical.h"
#include "occlusion/contacts.h"

namespace gnathion {

/// Along which the splint goes on, and what is in its way.
struct Insertion {
  Vector3 direction = Vector3::UnitZ();  ///< a: unit, towards the gingiva of the arch that wears the splint
  double tilt_deg = 0.0;                 ///< from the occlusal normal
  double undercut_mm3 = 0.0;             ///< of the crowns down to the cutting surface, blocked out but for r
  double undercut_at_normal_mm3 = 0.0;   ///< the same along the occlusal normal
};

struct Aperture {
  double area_mm2 = 0.0;
  Vector3 centre_mm = Vector3::Zero();  ///< Dental
  std::vector<std::uint8_t> teeth;      ///< FDI numbers of the arch that wears the splint, where known
  std::string cause;
};

/// Where the opposing arch comes to rest: the splint settled on its arch, then the opposing arch on the
/// splint, as rigid bodies under a bite force; told against TP, relative to the same settling of the natural
/// MI.
struct PredictedSeating {
  double alpha_deg = 0.0;
  double t_mm = 0.0;          ///< displacement of the arch's centroid
  double max_tooth_mm = 0.0;  ///< largest displacement over the crowns
  // What each of the three settlings moved, and the splint's play on its arch.
  double splint_mm = 0.0, bite_mm = 0.0, natural_mm = 0.0;
  double play_mm = 0.0;  ///< half of the way to and fro across a, seated lightly
};

struct SplintVerification {
  MeshTopology topology;
  std::size_t self_intersections = 0;
  double volume_mm3 = 0.0;
  /// Distance from the cavity's surface to the outer surface; rims and aperture walls left out.
  struct Thickness {
    double min_mm = 0.0, p01_mm = 0.0, median_mm = 0.0;
    Vector3 where_mm = Vector3::Zero();
  } thickness;
  double thin_under_contact_mm2 = 0.0;  ///< biting surface with less than w (but at least w_a) behind it
  struct SeatGap {
    double min_mm = 0.0, median_mm = 0.0, max_mm = 0.0;
  } seat_gap;                           ///< from the cavity's surface to the teeth
  double maxilla_penetration_mm = 0.0;  ///< deepest, either surface inside the other; jaws in TP
  double mandible_penetration_mm = 0.0;
  Contacts contacts;                      ///< of the opposing arch in TP with the splint, gap <= 0.05 mm
  double natural_contact_area_mm2 = 0.0;  ///< of the opposing arch in MI with S_occ, same limit
  double kept_fraction = 0.0;             ///< part of the natural contact area that the splint keeps
  double kept_outside_apertures = 0.0;    ///< the same of what has room for the thinnest wall over it in TP
  struct SurfaceError {
    double mean_abs_mm = 0.0, p99_mm = 0.0, max_mm = 0.0;
    std::size_t samples = 0;
  } contact_surface_error;  ///< of the splint against S_occ in TP less the opposing arch, within the contacts
  std::vector<Aperture> apertures;
  std::optional<ContactSigma> contact_sigma;  ///< where T_th's covariance is known
  double retention_area_mm2 = 0.0;            ///< of the cavity's surface below the height of contour
  Retention retention;                        ///< the arch's undercuts, and what the splint holds of them
  /// The opposing arch on its excursions: how deep it runs into the splint.
  struct Freedom {
    std::size_t poses = 0;  ///< looked at
    double deepest_mm = 0.0;
  };
  std::optional<Freedom> freedom;  ///< where excursions were asked for
  /// The splint moved from -12 mm·a to its seat: how deep it and its arch run into each other on the way.
  struct Insertability {
    double deepest_mm = 0.0;
    double before_seat_mm = 0.0;           ///< how far from the seat that happens
    Vector3 where_mm = Vector3::Zero();    ///< on the seated splint, Dental
    std::vector<std::uint8_t> teeth = {};  ///< FDI number of the tooth there, where known
  } insertability;
  /// What the opposing arch pressed into the splint, seen along its opening path.
  struct Imprint {
    double depth_mm = 0.0;  ///< of its walls beyond the natural relief of S_occ
    /// The same but for walls that have no more than w over the cavity: those stand.
    double avoidable_mm = 0.0;
    struct Place {
      double depth_mm = 0.0, area_mm2 = 0.0;
      Vector3 where_mm = Vector3::Zero();    ///< deepest, on the splint, Dental
      std::vector<std::uint8_t> teeth = {};  ///< FDI number of the tooth under the wall, where known
    };
    std::vector<Place> held_by_wall;  ///< deeper than d since w is kept; the deepest first
    Vector3 deepest_where_mm = Vector3::Zero();
    double undercut_mm =
        0.0;  ///< how deep the arch runs into the splint as it opens along the occlusal normal
    Vector3 undercut_where_mm = Vector3::Zero();
  } imprint;
  std::optional<BiteReadout> bite;  ///< nothing where an arch has no central incisor
  /// Where supports would have to stand when it is printed in the best direction.
  struct Build {
    Vector3 up = Vector3::UnitZ();     ///< unit, Dental: away from the plate
    double overhang_mm2 = 0.0;         ///< facing the plate more than 45° from the vertical
    double cavity_overhang_mm2 = 0.0;  ///< of that, inside the cavity
  } build;
  std::optional<PredictedSeating> predicted_seating;
  std::string seating_note;  ///< why there is none
};

/// A bar that the result must meet.
struct Gate {
  std::string name;
  double value = 0.0;
  double limit = 0.0;
  bool pass = false;
  bool blocks = true;  ///< a failed gate that blocks makes the verdict "fail"
};

}  // namespace gnathion
