#!/usr/bin/env bash
# The command line as a user meets it: exit codes, one line of error, nothing left behind. Usage: cli.sh GNATHION
set -u
gnathion=$1
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
failures=0

# expect CODE PATTERN command...: exit code, one line on stderr that matches, and no output left behind.
expect() {
  local code=$1 pattern=$2
  shift 2
  "$@" >"$work/stdout" 2>"$work/stderr"
  local got=$?
  if [ "$got" -ne "$code" ]; then
    echo "FAILED: exit $got, not $code: $*"; cat "$work/stderr"; failures=$((failures + 1)); return
  fi
  if [ -n "$pattern" ] && { [ "$(wc -l <"$work/stderr")" -ne 1 ] || ! grep -qE "$pattern" "$work/stderr"; }; then
    echo "FAILED: stderr is not one line with '$pattern': $*"; cat "$work/stderr"; failures=$((failures + 1)); return
  fi
  if ls -A "$work" | grep -qE '(staging|part)'; then
    echo "FAILED: left a half-written output: $*"; failures=$((failures + 1)); rm -rf "$work"/.out.*
  fi
  if [ "$code" -ne 0 ] && [ -e "$work/out" ]; then
    echo "FAILED: left an output behind: $*"; failures=$((failures + 1)); rm -rf "$work/out"
  fi
}

design() { expect "$1" "$2" "$gnathion" design --maxilla "$3" --mandible "$4" --transform "$5" --out "$work/out"; }

# A small closed box in the shape of nothing dental, and broken variants of files.
python3 - "$work" <<'PY'
import struct, sys
work = sys.argv[1]
def box(scale):
    v = [(x * 60 * scale, y * 50 * scale, z * 15 * scale) for z in (0, 1) for y in (0, 1) for x in (0, 1)]
    f = [(0,2,1),(1,2,3),(4,5,6),(5,7,6),(0,1,4),(1,5,4),(2,6,3),(3,6,7),(0,4,2),(2,4,6),(1,3,5),(3,7,5)]
    return struct.pack('<80xI', len(f)) + b''.join(
        struct.pack('<12fH', 0, 0, 0, *v[a], *v[b], *v[c], 0) for a, b, c in f)
def write(name, data):
    open(work + '/' + name, 'wb').write(data)
write('box.stl', box(1))
write('metres.stl', box(0.001))
write('micrometres.stl', box(1000))
write('truncated.stl', box(1)[:-70])
write('empty.stl', b'')
write('nan.stl', box(1)[:84 + 12] + struct.pack('<f', float('nan')) + box(1)[84 + 16:])
write('flat.stl', struct.pack('<80xI', 1) + struct.pack('<12fH', *([0.0] * 12), 0))
write('garbage.ply', b'ply\nformat binary_little_endian 1.0\nelement vertex 99999999\nproperty float x\nend_header\nxx')
write('identity.txt', b'1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\n')
write('scaled.txt', b'1.1 0 0 0 0 1.1 0 0 0 0 1.1 0 0 0 0 1\n')
write('mirror.txt', b'-1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\n')
write('short.txt', b'1 0 0\n')
write('deep.json', b'{"kind":' + b'[' * 3000 + b']' * 3000 + b'}')
tag = '[[tag]]\nid = %d\ncorners_mm = [[0,0,0],[20,0,0],[20,20,0],[0,20,0]]\n'
for name, first in (('bow', 0), ('head_frame', 20)):
    write(name + '.toml', ('name = "%s"\n' % name + tag % first).encode())
write('rig.toml', b'''bow = "bow.toml"
head_frame = "head_frame.toml"
[[camera]]
name = "camera_0"
width_px = 1280
height_px = 720
fx_px = 1100
fy_px = 1100
cx_px = 639.5
cy_px = 359.5
k1 = 0
k2 = 0
p1 = 0
p2 = 0
k3 = 0
rig_from_camera = [1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1]
''')
write('not.mcap', b'this is not a recording')
write('case.toml', b'[scans]\nmaxila_mi = "x"\n')
PY
id=$work/identity.txt box=$work/box.stl

bow_film() { "$gnathion" calibrate bow --rig "$work/rig.toml" --bow "$work/bow.toml" --out "$work/out" "$@"; }
expect 2 'a distance is' bow_film --recording "$work/not.mcap" --distance 0-7
expect 4 'not.mcap' bow_film --recording "$work/not.mcap"
expect 4 'absent.stl' "$gnathion" bow print --maxilla "$work/absent.stl" --mandible "$work/box.stl" --out "$work/out"
design 4 'absent.stl' "$work/absent.stl" "$box" "$id"
design 4 'empty.stl.*empty' "$work/empty.stl" "$box" "$id"
design 4 'truncated.stl.*truncated' "$work/truncated.stl" "$box" "$id"
design 4 'nan.stl' "$work/nan.stl" "$box" "$id"
design 4 'flat.stl' "$work/flat.stl" "$box" "$id"
design 4 'garbage.ply' "$work/garbage.ply" "$box" "$id"
design 4 'metres.stl.*metres' "$work/metres.stl" "$box" "$id"
design 4 'micrometres.stl.*micrometres' "$work/micrometres.stl" "$box" "$id"
design 4 'scaled.txt.*determinant 1.331' "$box" "$box" "$work/scaled.txt"
design 4 'mirror.txt.*determinant -1' "$box" "$box" "$work/mirror.txt"
design 4 'short.txt.*3 numbers' "$box" "$box" "$work/short.txt"
design 4 'gnathion: ' "$box" "$box" "$id"   # two boxes are no jaws

# --force never takes an input or a folder that is not ours.
mkdir -p "$work/mine" && cp "$box" "$work/mine/u.stl"
expect 2 'holds the input' "$gnathion" design --maxilla "$work/mine/u.stl" --mandible "$box" --transform "$id" --out "$work/mine" --force
expect 2 'not a folder that gnathion wrote' "$gnathion" design --maxilla "$box" --mandible "$box" --transform "$id" --out "$work/mine" --force
expect 2 'is an input' "$gnathion" check --maxilla "$box" --mandible "$box" --transform "$id" --out "$box" --force
expect 2 'folder does not exist' "$gnathion" check --maxilla "$box" --mandible "$box" --transform "$id" --out "$work/nowhere/f.json"
[ -e "$work/mine/u.stl" ] && [ -s "$box" ] || { echo "FAILED: an input is gone"; failures=$((failures + 1)); }
expect 4 'kind' "$gnathion" check --maxilla "$box" --mandible "$box" --transform "$work/deep.json" --out "$work/out"

expect 2 'wrong usage' "$gnathion" frobnicate
expect 2 'wrong usage' "$gnathion" design --maxilla "$box"
expect 2 'voxel' "$gnathion" design --quiet --maxilla "$box" --mandible "$box" --transform "$id" --out "$work/out" --set design.voxel_mm=0
expect 2 'no_such' "$gnathion" design --quiet --maxilla "$box" --mandible "$box" --transform "$id" --out "$work/out" --set design.no_such=1
expect 2 'wrong usage' "$gnathion" print prepare
printf 'name = "p"\nspeed = 3\n' >"$work/printer.toml"
expect 4 'speed: no such key' "$gnathion" print prepare --design "$work" --profile "$work/printer.toml" --out "$work/plate"
expect 2 'gap_mm' "$gnathion" design ladder --quiet --maxilla "$box" --mandible "$box" --transform "$id" --out "$work/ladder" --gap 0.9
expect 2 'leave it out' "$gnathion" design ladder --quiet --maxilla "$box" --mandible "$box" --transform "$id" --out "$work/ladder" --label P1
plain=(--quiet --maxilla "$box" --mandible "$box" --transform "$id" --out "$work/out")
expect 2 '16=missing or 24=x,y,z' "$gnathion" design "${plain[@]}" --tooth 16
expect 2 'fdi is not' "$gnathion" design "${plain[@]}" --tooth 99=missing
expect 2 'label' "$gnathion" design "${plain[@]}" --label 'a"b'
expect 2 'kind' "$gnathion" design "${plain[@]}" --kind round
printf '1 2 3\n4 five 6\n' > "$work/margin.txt"
expect 4 'margin.txt:2.*three numbers' "$gnathion" design "${plain[@]}" --margin "$work/margin.txt"
printf '[[design.tooth]]\nfdi = 16\nmissing = true\nat_mm = [1, 2, 3]\n' > "$work/teeth.toml"
expect 4 'missing = true or at_mm' "$gnathion" design "${plain[@]}" --config "$work/teeth.toml"
expect 4 'not.mcap' "$gnathion" recording info "$work/not.mcap"
expect 4 'absent.mcap' "$gnathion" recording verify "$work/absent.mcap"
expect 4 "maxila_mi" "$gnathion" run "$work"
# Range and X-rays: what is asked for wrongly is told before anything is read.
jaws_of_box=(--maxilla "$box" --mandible "$box" --out "$work/out")
expect 2 'AXIS=LOW..HIGH' "$gnathion" range "${jaws_of_box[@]}" --x protrusion
expect 2 'axes are protrusion' "$gnathion" range "${jaws_of_box[@]}" --x sideways=0..1
expect 2 'one of them is needed' "$gnathion" xray "${jaws_of_box[@]}" --cbct "$work/absent.nrrd"
# Cases: made, looked into, listed, catalogued; what is wrong is told in one line.
root=$work/cases; mkdir "$root"
expect 0 '' "$gnathion" case create "$root/p-1" --patient-name 'Ewa Zielinska' --file "maxilla_mi=$work/box.stl"
expect 2 'exists' "$gnathion" case create "$root/p-1"
expect 2 "part of the patient's name" "$gnathion" case create "$root/zielinska" --patient-name 'Ewa Zielinska'
expect 2 'is no role' "$gnathion" case create "$root/p-2" --file "nose=$work/box.stl"
expect 4 'does not exist' "$gnathion" case add "$root/p-1" --file "mandible_mi=$work/absent.stl"
expect 2 'in the case already' "$gnathion" case add "$root/p-1" --file "maxilla_mi=$work/box.stl"
expect 4 'mandible_mi' "$gnathion" run "$root/p-1"
expect 4 'was not run' "$gnathion" case provenance "$root/p-1" splint.stl
expect 0 '' "$gnathion" case list "$root" --catalogue "$work/c.sqlite" --rebuild --json
grep -q '"case": "p-1"' "$work/stdout" || { echo "FAILED: case list"; failures=$((failures + 1)); }
expect 0 '' "$gnathion" case info "$root/p-1" --json
if grep -q -i zielinska "$work/stdout" "$work/c.sqlite"*; then echo "FAILED: a patient's name got out"; failures=$((failures + 1)); fi
[ "$(stat -c %a "$root/p-1" "$root/p-1/case.toml" "$root/p-1/scans" | tr '\n' ' ')" = "700 600 700 " ] || { echo "FAILED: modes of a case"; failures=$((failures + 1)); }
printf '[case]\nid = "p-1"\nkind = =\n' >"$root/p-1/case.toml"
expect 4 'line 3, column 8' "$gnathion" case info "$root/p-1"
expect 4 'does not exist' "$gnathion" case import "$work/absent" --out "$root/p-3"
printf 'shell { keywords "upper" file "../../etc/passwd" }' >"$work/w.dpw"
expect 4 "'..' is not allowed" "$gnathion" case import "$work/w.dpw" --out "$root/p-3"
expect 4 'is not a file' "$gnathion" audit verify "$work/absent.jsonl"
printf 'x\n' >"$work/audit.jsonl"
expect 3 '' "$gnathion" audit verify "$work/audit.jsonl"
grep -q 'line 1 is no line' "$work/stdout" || { echo "FAILED: audit verify"; failures=$((failures + 1)); }
expect 0 '' "$gnathion" --help
expect 0 '' "$gnathion" --version
for command in demo phantom 'recording info' 'recording verify' 'recording recover' 'recording capture' 'recording import' 'recording export' track 'calibrate chain' \
  'transform scans' 'transform motion' check design run 'case create' 'case add' 'case info' 'case list' 'case provenance' 'case import' \
  'case export' 'audit verify'; do
  expect 0 '' "$gnathion" $command --help
  grep -q -- '--json' "$work/stdout" || { echo "FAILED: $command --help names no --json"; failures=$((failures + 1)); }
done

# Recordings: whole, cut, recovered.
seed="$(dirname "$0")/../fuzz/corpus/recording/small"
expect 0 '' "$gnathion" recording info --json --quiet "$seed"
grep -q '"missing": 1' "$work/stdout" || { echo "FAILED: the ledger lost a lost frame"; failures=$((failures + 1)); }
head -c 2000 "$seed" >"$work/cut.mcap"
expect 4 'cut.mcap.*' "$gnathion" recording verify --quiet "$work/cut.mcap"

expect 4 'cut off' "$gnathion" track --recording "$work/cut.mcap" --rig "$work/rig.toml" --out "$work/out"

# Capture: one line for each device that cannot be opened; the others are recorded.
"$gnathion" recording recover --quiet "$seed" --out "$work/film.mcap"
printf '[[device]]\nkind = "replay"\nname = "a"\npath = "film.mcap"\nspeed = 0\n' >"$work/one.toml"
printf '[[device]]\nkind = "replay"\nname = "b"\npath = "absent.mcap"\n' >"$work/none.toml"
cat "$work/one.toml" "$work/none.toml" >"$work/both.toml"
expect 0 'absent.mcap: No such file' "$gnathion" recording capture --json --quiet --devices "$work/both.toml" --out "$work/again.mcap"
grep -q '"missing": 1' "$work/stdout" || { echo "FAILED: capture lost a lost frame"; failures=$((failures + 1)); }
expect 0 '' "$gnathion" recording verify --quiet "$work/again.mcap"
expect 2 'exists' "$gnathion" recording capture --devices "$work/one.toml" --out "$work/again.mcap"
"$gnathion" recording capture --quiet --devices "$work/none.toml" --out "$work/never.mcap" 2>/dev/null
[ $? -eq 4 ] && [ ! -e "$work/never.mcap" ] || { echo "FAILED: a capture without a device"; failures=$((failures + 1)); }

# One camera under two names: the second gets a line, the other devices are recorded.
printf '[[device]]\nkind = "camera"\nname = "left"\nsource = 97\n[[device]]\nkind = "camera"\nname = "right"\nsource = "/dev/video97"\n' >"$work/twice.toml"
cat "$work/one.toml" >>"$work/twice.toml"
"$gnathion" recording capture --quiet --devices "$work/twice.toml" --out "$work/twice.mcap" >/dev/null 2>"$work/twice.err"
[ $? -eq 0 ] && [ "$(grep -c "right: source /dev/video97 is already camera 'left'" "$work/twice.err")" -eq 1 ] && [ -s "$work/twice.mcap" ] ||
  { echo "FAILED: a camera named twice"; cat "$work/twice.err"; failures=$((failures + 1)); }

# SIGUSR1 asks every scanner for a scan; one whose camera is not plugged in answers with a line that says so.
printf '[[camera]]\nname = "d"\nwidth_px = 80\nheight_px = 60\nfx_px = 90\nfy_px = 90\ncx_px = 39.5\ncy_px = 29.5\nk1 = 0\nk2 = 0\np1 = 0\np2 = 0\nk3 = 0\nrig_from_camera = [1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1]\n' >"$work/depth.toml"
printf '[[device]]\nkind = "depth_camera"\nname = "face"\nvendor = "fffe"\nproduct = "fffe"\nintrinsics = "depth.toml"\ntimeout_s = 0.2\n' >"$work/scanner.toml"
"$gnathion" recording capture --devices "$work/scanner.toml" --out "$work/asked.mcap" >/dev/null 2>"$work/asked.err" &
capture=$!
for _ in $(seq 300); do grep -q "kill -USR1 $capture" "$work/asked.err" && break; sleep 0.1; done
kill -USR1 "$capture"
for _ in $(seq 100); do
  "$gnathion" recording recover --quiet --force "$work/asked.mcap" --out "$work/so_far.mcap" 2>/dev/null
  "$gnathion" recording info "$work/so_far.mcap" 2>/dev/null | grep -q 'no camera fffe:fffe' && break
  sleep 0.1
done
kill -TERM "$capture"
wait "$capture"
expect 0 '' "$gnathion" recording info "$work/asked.mcap"
grep -q 'no camera fffe:fffe' "$work/stdout" || { echo "FAILED: SIGUSR1 asked for no scan"; failures=$((failures + 1)); }

# Import and export: there and back, the same bytes again, nothing half-written.
sequence="$(dirname "$0")/../fuzz/corpus/plus_sequence/images.mha"
expect 0 '' "$gnathion" recording import --quiet --plus "$sequence" --out "$work/plus.mcap"
expect 0 '' "$gnathion" recording import --quiet --images "$sequence" --out "$work/plus_again.mcap"
cmp -s "$work/plus.mcap" "$work/plus_again.mcap" || { echo "FAILED: an import with other bytes"; failures=$((failures + 1)); }
expect 0 '' "$gnathion" recording export "$work/film.mcap" --quiet --out "$work/exported" --csv --images
for made in export.json ledger.csv; do
  [ -s "$work/exported/$made" ] || { echo "FAILED: export wrote no $made"; failures=$((failures + 1)); }
done
expect 2 'exists' "$gnathion" recording export "$work/film.mcap" --out "$work/exported"
expect 2 'give --rate-hz' "$gnathion" recording import --images "$work/exported/camera_0" --out "$work/back.mcap"
expect 0 '' "$gnathion" recording import --quiet --images "cam=$work/exported/camera_0" --rate-hz 60 --out "$work/back.mcap"
expect 4 'is no video' "$gnathion" recording import --images "$work/one.toml" --rate-hz 60 --out "$work/none.mcap"
expect 2 'ends in .igs.mha' "$gnathion" recording export "$work/film.mcap" --out "$work/none" --plus x.txt
[ ! -e "$work/none.mcap" ] && [ ! -e "$work/none" ] || { echo "FAILED: a refused import or export left something"; failures=$((failures + 1)); }

# Motions.
printf 'time_s,valid,reason,x_mm,y_mm,z_mm,qw,qx,qy,qz,sigma_mm\n' >"$work/still.csv"
for i in 1 2 3 4 5 6 7 8 9 10 11 12; do echo "$i,1,,0,0,0,1,0,0,0,0.02" >>"$work/still.csv"; done
printf 'incisal_mm = [0, 0, 0]\nmolar_left_mm = [23, 30, 0]\nmolar_right_mm = [-23, 30, 0]\n' >"$work/landmarks.toml"
expect 4 'static' "$gnathion" motion analyse --motion "$work/still.csv" --landmarks "$work/landmarks.toml" --out "$work/out"
expect 2 'landmarks' "$gnathion" motion analyse --motion "$work/still.csv" --out "$work/out"
expect 2 'a movement is' "$gnathion" motion analyse --motion "$work/still.csv" --landmarks "$work/landmarks.toml" --movement jump=1..2 --out "$work/out"
expect 2 'rig or --electromagnetic' "$gnathion" track --recording "$work/film.mcap" --out "$work/out"
printf '[bow]\nstream = "bow/1"\nbody_from_sensor = [1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1]\n[head]\nstream = "bow/2"\n' >"$work/em.toml"
expect 4 'no valid pose' "$gnathion" track --recording "$work/film.mcap" --electromagnetic "$work/em.toml" --out "$work/out"
printf '0,0,0,1,1,1\n60,0,0,61,1,1\n0,40,0,1,41,1\n20,10,30,21,11,31\n-10,5,9,-9,6,10\n' >"$work/points.csv"
expect 0 '' "$gnathion" calibrate sensor --quiet --points "$work/points.csv" --out "$work/sensor.json"
expect 2 'give --points' "$gnathion" calibrate sensor --out "$work/out"

# Cameras, and the offset between instruments.
mkdir -p "$work/blank" "$work/sizes" "$work/none"
for i in 1 2 3; do { printf 'P5 64 48 255\n'; head -c 3072 /dev/zero; } >"$work/blank/$i.pgm"; done
cp "$work/blank/1.pgm" "$work/sizes/1.pgm"
{ printf 'P5 32 32 255\n'; head -c 1024 /dev/zero; } >"$work/sizes/2.pgm"
camera() { expect "$1" "$2" "$gnathion" calibrate camera --images "$3" --board "$4" --out "$work/out.json"; }
camera 4 'in none of 3 images: no chessboard of 9x6' "$work/blank" chessboard:9x6:25
camera 4 'in none of 3 images: no tag' "$work/blank" aprilgrid:6x6:30:0.3
camera 4 'images of one camera have one size' "$work/sizes" chessboard:9x6:25
camera 4 'holds no images' "$work/none" chessboard:9x6:25
camera 4 'no folder' "$work/absent" chessboard:9x6:25
camera 2 'a board is chessboard' "$work/blank" chessbord:9x6:25
camera 2 'no such ArUco dictionary' "$work/blank" charuco:7x5:30:22:9X9_50
expect 2 'give --images or --recording' "$gnathion" calibrate camera --board chessboard:9x6:25 --out "$work/out.json"
expect 2 'needs two cameras' "$gnathion" calibrate rig --camera a="$work/blank" --board chessboard:9x6:25 --out "$work/out.json"
expect 2 'NAME=FOLDER' "$gnathion" calibrate rig --camera a --camera b --board chessboard:9x6:25 --out "$work/out.json"
expect 4 'no images of .left' "$gnathion" calibrate rig --recording "$work/film.mcap" --streams left right --board chessboard:9x6:25 --out "$work/out.json"
expect 4 'streams? of poses' "$gnathion" calibrate time --recording "$work/film.mcap" --streams a b --out "$work/out"
expect 4 'not.mcap' "$gnathion" calibrate time --recording "$work/not.mcap" --streams a b --out "$work/out"
printf '{"kind": "time_calibration", "first": "a", "second": "b", "offset_s": 0.01}' >"$work/time.json"
expect 4 "has no stream 'b'" "$gnathion" recording shift "$work/film.mcap" --time "$work/time.json" --out "$work/out"

# Real pictures of a chessboard, where they are.
pictures=../shared/data/camera
if [ -d "$pictures" ]; then
  mkdir -p "$work/left" "$work/right" "$work/same"
  cp $pictures/left0[1-9].jpg $pictures/left1*.jpg "$work/left"; cp $pictures/right0[1-9].jpg $pictures/right1*.jpg "$work/right"
  for i in 1 2 3 4 5; do cp $pictures/left01.jpg "$work/same/$i.jpg"; done
  camera 4 '5 views of the board, 1 distinct' "$work/same" chessboard:9x6:25
  camera 4 'they show a chessboard of 9x6' "$work/same" chessboard:8x6:25
  expect 0 '' "$gnathion" calibrate rig --quiet --camera left="$work/left" --camera right="$work/right" --board chessboard:9x6:25 \
    --bow bow.toml --head-frame head_frame.toml --out "$work/stereo.json"
  [ -s "$work/stereo.png" ] || { echo "FAILED: no picture of the calibration"; failures=$((failures + 1)); }
  # The rig that was written is one that track reads: it gets as far as the recording's own cameras.
  expect 4 "no frame of|stereo.toml has|pixels|left" "$gnathion" track --recording "$work/film.mcap" --rig "$work/stereo.toml" --out "$work/out"
else
  echo "SKIPPED: no pictures in $pictures"
fi

# Volumes.
volumes=tests/fuzz/corpus/dicom
expect 0 '' "$gnathion" cbct info --quiet $volumes/raw.nrrd
expect 0 '' "$gnathion" cbct info --quiet $volumes/explicit.dcm
expect 4 'neither DICOM nor NIfTI nor NRRD' "$gnathion" cbct info README.md
expect 4 'no such file' "$gnathion" cbct surface --cbct nowhere --out "$work/bone.stl"

# Real jaws, where they are.
jaws=../shared/data/jaws
if [ -d "$jaws" ]; then
  expect 3 '' "$gnathion" design --quiet --json --maxilla $jaws/crowns/maxilla.stl --mandible $jaws/crowns/mandible_mi.stl \
    --transform $jaws/crowns/transforms/90_impossible_up1.txt --out "$work/refused"
  grep -q '"verdict": "not_realizable"' "$work/refused/design.json" && grep -q 'no_intersection' "$work/refused/design.json" ||
    { echo "FAILED: a refusal without its reason"; failures=$((failures + 1)); }
  expect 2 'exists' "$gnathion" design --quiet --maxilla $jaws/crowns/maxilla.stl --mandible $jaws/crowns/mandible_mi.stl \
    --transform $jaws/crowns/transforms/01_open.txt --out "$work/refused"
else
  echo "SKIPPED: no real jaws in $jaws"
fi

[ "$failures" -eq 0 ] && echo "all command line checks passed"
exit $((failures > 0))
