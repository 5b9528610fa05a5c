// Values under the pointer, and zoom: drag across a plot, double-click to see everything again. Time
// plots zoom together. Points are read back from the drawing itself; nothing else is stored.
(()=>{
const num=s=>s.split(',').map(Number),px=v=>v.toFixed(1);
const esc=t=>t.replace(/&/g,'&amp;').replace(/</g,'&lt;');
const plots=[...document.querySelectorAll('svg.plot')].map(svg=>{
 const [bx,by,bw,bh]=num(svg.dataset.box),X=num(svg.dataset.x),Y=num(svg.dataset.y),q=s=>svg.querySelector(s);
 return {svg,bx,by,bw,bh,X,Y,equal:'equal' in svg.dataset,decades:'decades' in svg.dataset,
  time:'time' in svg.dataset,hover:q('.hover'),gx:q('.gx'),gy:q('.gy'),view:[...X,...Y],saved:null,lines:null};
});
// Path data to runs of points, in the pixels of the drawing.
const runs=d=>{const out=[];let x=0,y=0,run;
 for(const m of d.matchAll(/([Mml])([^Mmlh]*)/g)){
  const n=(m[2].match(/-?(?:\d+\.?\d*|\.\d+)/g)||[]).map(Number);
  for(let i=0;i+1<n.length;i+=2){
   if(m[1]=='M'){x=n[i];y=n[i+1]}else{x+=n[i];y+=n[i+1]}
   if(m[1]=='l')run.push([x,y]);else{run=[[x,y]];out.push(run)}}}
 return out};
const read=p=>p.lines||(p.lines=[...p.svg.querySelectorAll('[data-name]')].map(e=>({e,name:e.dataset.name,
 d:e.getAttribute('d'),dots:e.classList.contains('dots'),runs:runs(e.getAttribute('d'))})));
// Between data, pixels of the drawing as it came, and pixels now.
const sx=(p,v)=>p.bx+(v-p.view[0])/(p.view[1]-p.view[0])*p.bw,sy=(p,v)=>p.by+p.bh-(v-p.view[2])/(p.view[3]-p.view[2])*p.bh;
const ox=(p,x)=>p.X[0]+(x-p.bx)/p.bw*(p.X[1]-p.X[0]),oy=(p,y)=>p.Y[1]-(y-p.by)/p.bh*(p.Y[1]-p.Y[0]);
const vx=(p,x)=>p.view[0]+(x-p.bx)/p.bw*(p.view[1]-p.view[0]),vy=(p,y)=>p.view[3]-(y-p.by)/p.bh*(p.view[3]-p.view[2]);
const ticks=(low,high,wanted)=>{const raw=(high-low)/Math.max(wanted,1),ten=10**Math.floor(Math.log10(raw));
 const step=[1,2,5,10].map(m=>m*ten).find(s=>s>=raw*(1-1e-9)),digits=Math.min(9,Math.max(0,-Math.floor(Math.log10(step)+1e-9))),out=[];
 for(let i=Math.ceil(low/step-1e-9);i<=high/step+1e-9&&out.length<100;i++)out.push([i*step,(i*step).toFixed(digits).replace('-','\u2212')]);
 return out};
// A run cut to what is seen in x.
const cut=(run,a,b)=>{const out=[];let before=null;
 for(const q of run){
  if(before){for(const edge of[a,b])if((before[0]-edge)*(q[0]-edge)<0){
   const t=(edge-before[0])/(q[0]-before[0]);out.push([edge,before[1]+t*(q[1]-before[1])])}}
  if(q[0]>=a&&q[0]<=b)out.push(q);before=q}
 return out};
const draw=p=>{
 const whole=p.view.every((v,i)=>v==[...p.X,...p.Y][i]);
 if(!p.saved)p.saved=[p.gx&&p.gx.innerHTML,p.gy&&p.gy.innerHTML];
 read(p);
 // A place of the drawing as it came, now.
 const fx=x=>sx(p,ox(p,x)),fy=y=>sy(p,oy(p,y)),a=p.bx+(p.view[0]-p.X[0])/(p.X[1]-p.X[0])*p.bw,b=p.bx+(p.view[1]-p.X[0])/(p.X[1]-p.X[0])*p.bw;
 const shown=p.lines.map(l=>l.runs.map(r=>cut(r,a,b)).filter(r=>r.length));
 if(!p.equal&&!p.decades&&p.lines.length&&!whole){
  let low=Infinity,high=-Infinity;shown.forEach((l,i)=>p.lines[i].e.classList.contains('bound')||l.forEach(r=>r.forEach(q=>{const v=oy(p,q[1]);if(v<low)low=v;if(v>high)high=v})));
  if(low<=high){const least=(p.Y[1]-p.Y[0])/200,more=Math.max(high-low,least)*.08+Math.max(0,least-(high-low))/2;p.view[2]=low-more;p.view[3]=high+more+(p.svg.querySelector('[data-span]')?more:0)}
 }
 const seen=q=>!p.equal||(q[1]>=p.by-1&&q[1]<=p.by+p.bh+1);
 p.lines.forEach((l,i)=>l.e.setAttribute('d',whole?l.d:shown[i].map(r=>{let pen=false;return r.map(q=>[fx(q[0]),fy(q[1])]).map(q=>{
  if(!seen(q)){pen=false;return ''}
  const s=(pen?'L':'M')+px(q[0])+' '+px(q[1])+(l.dots?'h0':'');pen=!l.dots;return s}).join('')}).join('')));
 const right=p.bx+p.bw,foot=p.by+p.bh;
 if(p.gx&&p.saved[0])p.gx.innerHTML=whole?p.saved[0]:ticks(p.view[0],p.view[1],p.bw/70).map(([v,t])=>{const x=px(sx(p,v));
  return `<line class="grid" x1="${x}" x2="${x}" y1="${p.by}" y2="${foot}"/><text class="tick mid" x="${x}" y="${foot+14}">${t}</text>`}).join('');
 if(p.gy&&p.saved[1]&&!p.decades)p.gy.innerHTML=whole?p.saved[1]:ticks(p.view[2],p.view[3],p.bh/34).map(([v,t])=>{const y=sy(p,v);
  return `<line class="grid" x1="${p.bx}" x2="${right}" y1="${px(y)}" y2="${px(y)}"/><text class="tick end" x="${p.bx-5}" y="${px(y+3.5)}">${t}</text>`}).join('');
 p.svg.querySelectorAll('[data-span]').forEach(g=>{const [u,v]=num(g.dataset.span).map(fx),x=Math.max(u,p.bx),w=Math.min(v,right)-x,
  rect=g.querySelector('rect'),text=g.querySelector('text');g.style.display=v<p.bx||u>right?'none':'';
  rect.setAttribute('x',px(x));rect.setAttribute('width',px(Math.max(w,1)));
  if(text){text.setAttribute('x',px(x+w/2));text.setAttribute('visibility',w<(text.dataset.width||text.textContent.length*6.1)?'hidden':'visible')}});
 p.svg.querySelectorAll('[data-at]').forEach(g=>{const x=+g.dataset.at,n=fx(x);g.style.display=n<p.bx||n>right?'none':'';g.setAttribute('transform',`translate(${px(n-x)} 0)`)});
 p.svg.querySelectorAll('g[data-y]').forEach(g=>{const y=+g.dataset.y,n=fy(y);g.style.display=n<p.by||n>foot?'none':'';g.setAttribute('transform',`translate(0 ${px(n-y)})`)});
 p.svg.querySelectorAll('[data-pin]').forEach(g=>{const [x,y]=num(g.dataset.pin),n=fx(x),m=fy(y);
  g.style.display=n<p.bx||n>right||m<p.by||m>foot?'none':'';g.setAttribute('transform',`translate(${px(n-x)} ${px(m-y)})`)});
};
const back=document.createElement('button');back.className='back';back.textContent='show everything';back.hidden=true;document.body.append(back);
const all=()=>{plots.forEach(p=>{if(p.saved){p.view=[...p.X,...p.Y];draw(p);p.hover.innerHTML=''}});back.hidden=true};
const zoom=(p,view)=>{back.hidden=false;
 (p.time?plots.filter(o=>o.time):[p]).forEach(o=>{o.view=o===p&&p.equal?view:[view[0],view[1],o.Y[0],o.Y[1]];draw(o);o.hover.innerHTML=''})};
back.onclick=all;document.addEventListener('keydown',e=>{if(e.key=='Escape')all()});
plots.forEach(p=>{
 const at=e=>{const m=p.svg.getScreenCTM().inverse();return [e.clientX*m.a+e.clientY*m.c+m.e,e.clientX*m.b+e.clientY*m.d+m.f]};
 const inX=x=>Math.min(p.bx+p.bw,Math.max(p.bx,x)),inY=y=>Math.min(p.by+p.bh,Math.max(p.by,y)),show=v=>+v.toPrecision(5)+'';
 let from=null;
 p.svg.addEventListener('pointerdown',e=>{const q=at(e);if(e.button==0&&q[0]>=p.bx&&q[0]<=p.bx+p.bw&&q[1]>=p.by){from=q;e.preventDefault()}});
 p.svg.addEventListener('dblclick',e=>{e.preventDefault();all()});
 p.svg.addEventListener('pointerleave',()=>{p.hover.innerHTML='';from=null});
 p.svg.addEventListener('pointercancel',()=>{p.hover.innerHTML='';from=null});
 p.svg.addEventListener('pointerup',e=>{
  if(!from)return;const q=at(e),x=[inX(from[0]),inX(q[0])].sort((a,b)=>a-b),y=[inY(from[1]),inY(q[1])].sort((a,b)=>a-b);from=null;
  if(x[1]-x[0]<6)return;
  if(!p.equal)return zoom(p,[vx(p,x[0]),vx(p,x[1])]);
  // A map keeps its scale: the larger side decides.
  const k=Math.max((x[1]-x[0])/p.bw,(y[1]-y[0])/p.bh)/2,cx=(x[0]+x[1])/2,cy=(y[0]+y[1])/2;
  zoom(p,[vx(p,cx-k*p.bw),vx(p,cx+k*p.bw),vy(p,cy+k*p.bh),vy(p,cy-k*p.bh)])});
 p.svg.addEventListener('pointermove',e=>{
  const [x,y]=at(e);
  if(x<p.bx||x>p.bx+p.bw){p.hover.innerHTML='';return}
  if(from){const a=inX(Math.min(x,from[0])),w=inX(Math.max(x,from[0]))-a,t=p.equal?inY(Math.min(y,from[1])):p.by,h=p.equal?inY(Math.max(y,from[1]))-t:p.bh;
   p.hover.innerHTML=`<rect class="pick" x="${px(a)}" y="${px(t)}" width="${px(w)}" height="${px(h)}"/>`;return}
  const rows=[show(vx(p,x))],ways=(p.bx+(vx(p,x)-p.X[0])/(p.X[1]-p.X[0])*p.bw),near=6*(p.view[1]-p.view[0])/(p.X[1]-p.X[0]);
  const mapY=p.by+(p.Y[1]-vy(p,y))/(p.Y[1]-p.Y[0])*p.bh;
  read(p).forEach(l=>{let best=null,far=Infinity;
   l.runs.forEach(r=>{if(!p.equal&&(r[0][0]>ways+near||r[r.length-1][0]<ways-near))return;
    r.forEach(q=>{const d=p.equal?Math.hypot(q[0]-ways,q[1]-mapY):Math.abs(q[0]-ways);if(d<far){far=d;best=q}})});
   if(best&&far<=near){const v=oy(p,best[1]);rows.push((l.name||'value')+'  '+(p.equal?show(ox(p,best[0]))+', ':'')+show(p.decades?10**v:v))}});
  const w=Math.max(...rows.map(r=>r.length))*6.2+12,left=x+w+10>p.bx+p.bw?x-w-6:x+6;
  p.hover.innerHTML=`<line x1="${px(x)}" x2="${px(x)}" y1="${p.by}" y2="${p.by+p.bh}"/><rect x="${px(left)}" y="${p.by+4}" width="${px(w)}" height="${rows.length*14+6}" rx="3"/>`+
   rows.map((r,i)=>`<text x="${px(left+6)}" y="${p.by+17+i*14}">${esc(r)}</text>`).join('');
 });
});
})();
