//! Modules that glslang does not write, or not of a small text, mean what the text beside them means.

use std::path::Path;

use crate::spirv_in::{VERTEX, assembled_only, scratch, try_glslang};
use crate::spirv_meaning::{differences, of_bytes};

const HEAD: &str = "OpCapability Shader
%1 = OpExtInstImport \"GLSL.std.450\"
OpMemoryModel Logical GLSL450
OpEntryPoint Fragment %main \"main\" %vUv %c
OpExecutionMode %main OriginUpperLeft
OpName %vUv \"vUv\"
OpName %c \"c\"
OpDecorate %vUv Location 0
OpDecorate %c Location 0
%void = OpTypeVoid
%fn = OpTypeFunction %void
%float = OpTypeFloat 32
%int = OpTypeInt 32 1
%uint = OpTypeInt 32 0
%bool = OpTypeBool
%v2 = OpTypeVector %float 2
%v3 = OpTypeVector %float 3
%v4 = OpTypeVector %float 4
%pi = OpTypePointer Input %v2
%po = OpTypePointer Output %v4
%pof = OpTypePointer Output %float
%pff = OpTypePointer Function %float
%pfv = OpTypePointer Function %v4
%vUv = OpVariable %pi Input
%c = OpVariable %po Output
%i0 = OpConstant %int 0
%i1 = OpConstant %int 1
%i2 = OpConstant %int 2
%i4 = OpConstant %int 4
%f0 = OpConstant %float 0
%f1 = OpConstant %float 1
%f2 = OpConstant %float 2
%f8 = OpConstant %float 8
%true = OpConstantTrue %bool
%main = OpFunction %void None %fn
%entry = OpLabel
%xv = OpVariable %pff Function
%vv = OpVariable %pfv Function
%uv = OpLoad %v2 %vUv
%ux = OpCompositeExtract %float %uv 0
%uy = OpCompositeExtract %float %uv 1
%m8 = OpFMul %float %ux %f8
%sel = OpConvertFToS %int %m8
OpStore %xv %f0
";

const END: &str = "%res = OpLoad %float %xv
%out = OpCompositeConstruct %v4 %res %uy %f0 %f1
OpStore %c %out
OpReturn
OpFunctionEnd
";

/// The start of a loop of four turns: its body is open.
const LOOP: &str = "OpBranch %h
%h = OpLabel
%k = OpPhi %int %i0 %entry %k2 %cont
OpLoopMerge %lm %cont None
OpBranch %test
%test = OpLabel
%lt = OpSLessThan %bool %k %i4
OpBranchConditional %lt %body %lm
%body = OpLabel
%ks = OpIAdd %int %k %sel
%and = OpBitwiseAnd %int %ks %i4
%sw = OpISub %int %sel %k
";

/// The end of that loop, from its continue block on.
const LOOP_END: &str = "%cont = OpLabel
%k2 = OpIAdd %int %k %i1
OpBranch %h
%lm = OpLabel
";

/// What a module does between [`HEAD`] and [`END`], and the same in GLSL.
const MODULES: [(&str, &str); 15] = [
    // Two literals have one label, into which another case falls.
    (
"OpSelectionMerge %m None
OpSwitch %sel %m 1 %b 2 %a 3 %b
%a = OpLabel
%l1 = OpLoad %float %xv
%a1 = OpFAdd %float %l1 %f1
OpStore %xv %a1
OpBranch %b
%b = OpLabel
%l2 = OpLoad %float %xv
%a2 = OpFAdd %float %l2 %f8
OpStore %xv %a2
OpBranch %m
%m = OpLabel
",
"switch(sel){case 2: x+=1.0;
        case 1: case 3: x+=8.0;
        break;}",
),
    // A `default` continues the loop around, and a case leaves it.
    (
"LOOP
OpSelectionMerge %m None
OpSwitch %sw %cont 1 %a 2 %lm
%a = OpLabel
%l1 = OpLoad %float %xv
%a1 = OpFAdd %float %l1 %f1
OpStore %xv %a1
OpBranch %m
%m = OpLabel
%l2 = OpLoad %float %xv
%a2 = OpFAdd %float %l2 %f2
OpStore %xv %a2
OpBranch %cont
LOOP_END
",
"for(int k=0;k<4;k++){ int s = sel-k;
        if (s==1) {x+=1.0;}
        else if (s==2) break;
        else continue;
        x+=2.0;
        }",
),
    // A `default` leaves the loop around, and a case continues it.
    (
"LOOP
OpSelectionMerge %m None
OpSwitch %sw %lm 1 %a 2 %m 0 %cont
%a = OpLabel
%l1 = OpLoad %float %xv
%a1 = OpFAdd %float %l1 %f1
OpStore %xv %a1
OpBranch %m
%m = OpLabel
%p = OpPhi %float %f8 %body %f1 %a
%l2 = OpLoad %float %xv
%a2 = OpFAdd %float %l2 %p
OpStore %xv %a2
OpBranch %cont
LOOP_END
",
"for(int k=0;k<4;k++){ int s = sel-k;
        float p = 8.0;
        if (s==1) {x+=1.0;
        p = 1.0;}
        else if (s==0) continue;
        else if (s!=2) break;
         x+=p;
        }",
),
    // The header of a loop is that of a switch too, as older compilers write.
    (
"OpBranch %h
%h = OpLabel
%k = OpPhi %int %i0 %entry %k2 %cont
%sw = OpISub %int %sel %k
OpLoopMerge %lm %cont None
OpSwitch %sw %a 1 %lm 3 %cont
%a = OpLabel
%l1 = OpLoad %float %xv
%a1 = OpFAdd %float %l1 %f1
OpStore %xv %a1
%lt = OpSLessThan %bool %k %i4
OpBranchConditional %lt %cont %lm
%cont = OpLabel
%k2 = OpIAdd %int %k %i1
OpBranch %h
%lm = OpLabel
",
"for(int k=0;;k++){ int s = sel-k;
        if (s==1) break;
        if (s==3) continue;
        x+=1.0;
        if (k>=4) break;
        }",
),
    // Several switches are left for the end of the loop, where phis tell the ways apart.
    (
"LOOP
OpSelectionMerge %m None
OpSwitch %sw %m 1 %a 2 %b 3 %d
%a = OpLabel
OpBranch %lm
%b = OpLabel
%cb = OpFOrdLessThan %bool %uy %ux
OpBranchConditional %cb %lm %m
%d = OpLabel
OpSelectionMerge %m2 None
OpSwitch %k %m2 0 %lm 1 %e
%e = OpLabel
%l4 = OpLoad %float %xv
%a4 = OpFAdd %float %l4 %f8
OpStore %xv %a4
OpBranch %m2
%m2 = OpLabel
%l3 = OpLoad %float %xv
%a3 = OpFAdd %float %l3 %f8
OpStore %xv %a3
OpBranch %m
%m = OpLabel
%l2 = OpLoad %float %xv
%a2 = OpFAdd %float %l2 %f2
OpStore %xv %a2
OpBranch %cont
LOOP_END
%q = OpPhi %float %f0 %test %f1 %a %f2 %b %ux %d
%l9 = OpLoad %float %xv
%a9 = OpFAdd %float %l9 %q
OpStore %xv %a9
",
"float q = 0.0;
        for(int k=0;k<4;k++){ int s = sel-k;
        if (s==1) {q=1.0;break;}
        if (s==2) { if (vUv.y<vUv.x) {q=2.0;
        break;}
        }
        if (s==3) { if (k==0) {q=vUv.x;
        break;}
        if (k==1) x+=8.0;
        x+=8.0;
        }
        x+=2.0;
        }
        x+=q;",
),
    // No case ends its switch.
    (
"LOOP
OpSelectionMerge %m None
OpSwitch %sw %cont 1 %a 2 %b
%a = OpLabel
%l1 = OpLoad %float %xv
%a1 = OpFAdd %float %l1 %f1
OpStore %xv %a1
OpBranch %lm
%b = OpLabel
%l2 = OpLoad %float %xv
%a2 = OpFAdd %float %l2 %f2
OpStore %xv %a2
OpBranch %cont
%m = OpLabel
OpUnreachable
LOOP_END
",
"for(int k=0;k<4;k++){ int s = sel-k;
        if (s==1) {x+=1.0;break;}
        if (s==2) x+=2.0;
        }",
),
    // Nothing leads to a block.
    (
"%cc = OpFOrdLessThan %bool %ux %uy
OpSelectionMerge %m None
OpBranchConditional %cc %a %m
%a = OpLabel
%l1 = OpLoad %float %xv
%a1 = OpFAdd %float %l1 %f1
OpStore %xv %a1
OpBranch %m
%dead = OpLabel
%l2 = OpLoad %float %xv
%a2 = OpFAdd %float %l2 %f8
OpStore %xv %a2
OpBranch %m
%m = OpLabel
%p = OpPhi %float %f0 %entry %f1 %a %a2 %dead
%l3 = OpLoad %float %xv
%a3 = OpFAdd %float %l3 %p
OpStore %xv %a3
",
"float p = 0.0;
        if (vUv.x<vUv.y) {x+=1.0;
        p=1.0;}
        x+=p;",
),
    // A pointer is used in other blocks than its own.
    (
"%vvi = OpCompositeConstruct %v4 %ux %uy %f1 %f2
OpStore %vv %vvi
%idx = OpBitwiseAnd %int %sel %i1
%ch = OpAccessChain %pff %vv %idx
%cc = OpFOrdLessThan %bool %ux %uy
OpSelectionMerge %m None
OpBranchConditional %cc %a %m
%a = OpLabel
OpStore %ch %f8
OpBranch %m
%m = OpLabel
%ld = OpLoad %float %ch
OpStore %xv %ld
",
"vec4 v = vec4(vUv,1.0,2.0);
        if (vUv.x<vUv.y) v[sel&1]=8.0;
        x = v[sel&1];",
),
    // Functions of scalars, which WGSL has of vectors alone.
    (
"%n = OpExtInst %float %1 Normalize %ux
%r = OpExtInst %float %1 Reflect %ux %uy
%ff = OpExtInst %float %1 FaceForward %ux %uy %f1
%rf = OpExtInst %float %1 Refract %ux %uy %f2
%s1 = OpFAdd %float %n %r
%s2 = OpFAdd %float %s1 %ff
%s3 = OpFAdd %float %s2 %rf
OpStore %xv %s3
",
"float n = sign(vUv.x);
        float k = 1.0-4.0*(1.0-(vUv.y*vUv.x)*(vUv.y*vUv.x));
        x = vUv.x/abs(vUv.x) + (vUv.x - 2.0*(vUv.y*vUv.x)*vUv.y) + (vUv.y < 0.0 ? vUv.x : -vUv.x) + (k<0.0?0.0: 2.0*vUv.x - (2.0*(vUv.y*vUv.x)+sqrt(k))*vUv.y);",
),
    // One of two is NaN.
    (
"%nan = OpFDiv %float %f0 %f0
%cc = OpFOrdLessThan %bool %ux %uy
%q = OpSelect %float %cc %nan %ux
%va = OpCompositeConstruct %v3 %q %uy %ux
%vb = OpCompositeConstruct %v3 %uy %q %uy
%n1 = OpExtInst %v3 %1 NMin %va %vb
%n2 = OpExtInst %v3 %1 NMax %va %vb
%n3 = OpExtInst %v3 %1 NClamp %va %vb %vb
%e1 = OpCompositeExtract %float %n1 0
%e2 = OpCompositeExtract %float %n2 1
%s1 = OpFAdd %float %e1 %e2
OpStore %xv %s1
",
"float q = vUv.x<vUv.y ? uintBitsToFloat(0x7fc00000u) : vUv.x;
        bool b = vUv.x<vUv.y;
        x = (b ? vUv.y : min(q,vUv.y)) + (b ? vUv.y : max(vUv.y,q));",
),
    // Comparisons of NaN.
    (
"%nan = OpFDiv %float %f0 %f0
%cc = OpFOrdLessThan %bool %ux %uy
%q = OpSelect %float %cc %nan %ux
%b1 = OpFOrdNotEqual %bool %q %f1
%b2 = OpFUnordEqual %bool %q %f1
%b3 = OpFUnordNotEqual %bool %q %f1
%b4 = OpFOrdEqual %bool %q %f1
%s1 = OpSelect %float %b1 %f1 %f0
%s2 = OpSelect %float %b2 %f2 %f0
%s3 = OpSelect %float %b3 %f8 %f0
%s4 = OpSelect %float %b4 %ux %f0
%t1 = OpFAdd %float %s1 %s2
%t2 = OpFAdd %float %t1 %s3
%t3 = OpFAdd %float %t2 %s4
OpStore %xv %t3
",
"bool n = vUv.x < vUv.y || vUv.x != vUv.x;
        bool e = vUv.x == 1.0;
        x = ((!n && !e) ? 1.0:0.0) + ((n||e)?2.0:0.0) + ((n||!e)?8.0:0.0) + ((!n&&e)?vUv.x:0.0);",
),
    // The exponent is unsigned.
    (
"%us = OpBitcast %uint %sel
%b1 = OpExtInst %float %1 Ldexp %ux %us
OpStore %xv %b1
",
"x = ldexp(vUv.x, sel);",
),
    // A conditional branch falls into the next case.
    (
"%cc = OpFOrdLessThan %bool %ux %uy
OpSelectionMerge %m None
OpSwitch %sel %m 1 %a 2 %b
%a = OpLabel
%l1 = OpLoad %float %xv
%a1 = OpFAdd %float %l1 %f1
OpStore %xv %a1
OpBranchConditional %cc %b %m
%b = OpLabel
%l2 = OpLoad %float %xv
%a2 = OpFAdd %float %l2 %f8
OpStore %xv %a2
OpBranch %m
%m = OpLabel
",
"switch(sel){case 1: x+=1.0;
        if (!(vUv.x<vUv.y)) break;
        case 2: x+=8.0;
        break;}",
),
    // A choice ends where the next case begins.
    (
"%cc = OpFOrdLessThan %bool %ux %uy
OpSelectionMerge %m None
OpSwitch %sel %m 1 %a 2 %b
%a = OpLabel
%l1 = OpLoad %float %xv
%a1 = OpFAdd %float %l1 %f1
OpStore %xv %a1
OpSelectionMerge %b None
OpBranchConditional %cc %t %b
%t = OpLabel
%l3 = OpLoad %float %xv
%a3 = OpFAdd %float %l3 %f2
OpStore %xv %a3
OpBranch %m
%b = OpLabel
%l2 = OpLoad %float %xv
%a2 = OpFAdd %float %l2 %f8
OpStore %xv %a2
OpBranch %m
%m = OpLabel
",
"switch(sel){case 1: x+=1.0;
        if ((vUv.x<vUv.y)) {x+=2.0;
        break;}
        case 2: x+=8.0;
        break;}",
),
    // The merge block of a switch continues the loop around.
    (
"OpBranch %h
%h = OpLabel
%k = OpPhi %int %i0 %entry %k2 %cont
OpLoopMerge %lm %cont None
OpBranch %test
%test = OpLabel
%lt = OpSLessThan %bool %k %i4
OpBranchConditional %lt %body %lm
%body = OpLabel
%sw = OpISub %int %sel %k
OpSelectionMerge %cont None
OpSwitch %sw %cont 1 %a 2 %b
%a = OpLabel
%l1 = OpLoad %float %xv
%a1 = OpFAdd %float %l1 %f1
OpStore %xv %a1
OpBranch %cont
%b = OpLabel
%l2 = OpLoad %float %xv
%a2 = OpFAdd %float %l2 %f8
OpStore %xv %a2
OpBranch %lm
%cont = OpLabel
%k2 = OpIAdd %int %k %i1
OpBranch %h
%lm = OpLabel
",
"for(int k=0;k<4;k++){ int s=sel-k;
        if(s==1) x+=1.0;
        if (s==2) {x+=8.0;
        break;}
        }",
),
];

const INFINITE_CONSTANTS: &str = "%inf = OpConstant %float 0x1p+128
%ninf = OpConstant %float -0x1p+128
%nan = OpConstant %float 0x1.8p+128
%vinf = OpConstantComposite %v2 %inf %f2
%ppf = OpTypePointer Private %float
%ppv = OpTypePointer Private %v2
%far = OpVariable %ppf Private %inf
%fars = OpVariable %ppv Private %vinf
";

/// Constants that are infinite or no number, alone and in a composite, and variables that begin with
/// them.
const INFINITE: [(&str, &str); 3] = [
    (
        "%begin = OpLoad %float %far
%both = OpLoad %v2 %fars
%second = OpCompositeExtract %float %both 0
OpStore %far %f1
%now = OpLoad %float %far
%b1 = OpFOrdEqual %bool %begin %inf
%b2 = OpFOrdEqual %bool %second %inf
%all = OpLogicalAnd %bool %b1 %b2
%k = OpSelect %float %all %now %f2
OpStore %xv %k
",
        "x = 1.0;",
    ),
    (
        "OpStore %xv %inf
%held = OpLoad %float %xv
%b1 = OpFOrdLessThan %bool %ux %inf
%b2 = OpFOrdGreaterThan %bool %ux %ninf
%b3 = OpFOrdEqual %bool %held %inf
%both = OpLogicalAnd %bool %b1 %b2
%all = OpLogicalAnd %bool %both %b3
%k = OpSelect %float %all %f1 %f2
OpStore %xv %k
",
        "x = 1.0;",
    ),
    (
        "%b1 = OpFOrdEqual %bool %nan %nan
%b2 = OpFOrdLessThan %bool %ux %nan
%any = OpLogicalOr %bool %b1 %b2
%k = OpSelect %float %any %f1 %f2
%low = OpExtInst %v2 %1 FMin %uv %vinf
%lx = OpCompositeExtract %float %low 0
%sum = OpFAdd %float %lx %k
OpStore %xv %sum
",
        "x = min(vUv.x, 3e38) + 2.0;",
    ),
];

#[test]
fn modules_mean_what_is_beside_them() {
    let dir = scratch();
    std::fs::create_dir_all(&dir).unwrap();
    let path = dir.join("m.vert");
    let vertex = VERTEX.replace(" v;", " vUv;").replace("v=", "vUv=");
    std::fs::write(&path, &vertex).unwrap();
    let module = try_glslang(Path::new(&path), &[], &dir).unwrap();
    let infinite = INFINITE.map(|(body, text)| (INFINITE_CONSTANTS, body, text));
    let modules = MODULES.iter().map(|(body, text)| ("", *body, *text));
    for (constants, body, text) in modules.chain(infinite) {
        let body = body.replace("LOOP_END", LOOP_END).replace("LOOP", LOOP);
        let head = HEAD.replace("%main = Op", &format!("{constants}%main = Op"));
        let text = format!(
            "#version 450\nlayout(location=0) in vec2 vUv; layout(location=0) out vec4 c;\n\
             void main() {{ int sel = int(vUv.x * 8.0); float x = 0.0;\n{text}\n\
             c = vec4(x, vUv.y, 0.0, 1.0); }}\n"
        );
        let words = assembled_only(&format!("{head}{body}{END}"), &dir);
        let first = of_bytes([
            ("m.vert", vertex.clone().into()),
            ("m.frag", text.clone().into()),
        ]);
        let second = of_bytes([("m.vert.spv", module.clone()), ("m.frag.spv", words)]);
        let [first, second] = [first, second].map(|p| p.unwrap_or_else(|e| panic!("{text}: {e}")));
        let found = differences(&first, &second, false);
        assert!(found.is_empty(), "{text}: {found:?}");
    }
}
